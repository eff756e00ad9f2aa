"""Files that are not what they seem end in one line; what they hold is what other libraries wrote."""

import h5netcdf
import h5py
import numpy as np
import pytest
from scipy.io import netcdf_file

from usvauv.env.storage.netcdf import NetcdfError, open_decoded, open_plain, values

VALUES = np.arange(60, dtype="<f4").reshape(3, 4, 5) / 7


def test_types_of_no_interest_are_passed_over(tmp_path):
    with h5netcdf.File(tmp_path / "a.nc", "w") as file:
        file.dimensions = {"lat": 4}
        names = file.create_variable("names", ("lat",), h5py.string_dtype())
        names[...] = np.array(["north", "süd", "", "west"], object)
        names.attrs["units"] = 5
    with h5py.File(tmp_path / "a.nc", "a") as file:
        pair = np.zeros(4, [("u", "<f4"), ("v", "<f4")])
        file.create_dataset("pair", data=pair).dims[0].attach_scale(file["lat"])
    with open_decoded(tmp_path / "a.nc") as dataset:
        assert values(dataset["names"][1:3], "names").tolist() == ["süd", ""]
        assert dataset["names"].attrs["units"] == "5"


def test_a_classic_file(tmp_path):
    path = tmp_path / "classic.nc"
    with netcdf_file(path, "w") as file:
        file.title = b"s\xc3\xbcd"
        file.createDimension("x", 6)
        variable = file.createVariable("h", "i2", ("x",))
        variable.units = "m"
        variable.scale_factor = np.float32(0.25)
        variable[:] = np.arange(6) * 3
    with open_decoded(path) as dataset:
        assert dataset.attrs["title"] == "süd"
        assert dataset["h"].attrs["units"] == "m"
        assert values(dataset["h"][1:6:2], "h").tolist() == [0.75, 2.25, 3.75]
    with pytest.raises(NetcdfError, match=r"classic\.nc: not a NetCDF-4 file"), open_plain(path):
        pytest.fail("opened")


@pytest.mark.parametrize("content", [b"", b"\x89HDF\r\n\x1a\n", b"CDF\x01" + bytes(3)])
def test_a_file_that_cannot_be_opened_is_one_line(tmp_path, content):
    (tmp_path / "empty.nc").write_bytes(content)
    with (
        pytest.raises(NetcdfError, match=r"empty\.nc: (not a NetCDF file|cannot be read: )") as caught,
        open_decoded(tmp_path / "empty.nc"),
    ):
        pytest.fail("opened")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", ["storage", "virtual", "soft", "external", "filter"])
def test_what_leads_out_of_a_file_is_refused_before_it_is_read(tmp_path, kind):
    (tmp_path / "secret").write_bytes(VALUES.tobytes())
    with h5py.File(tmp_path / "other.nc", "w") as other:
        other["x"] = VALUES
    with h5py.File(tmp_path / "trace.nc", "w") as file:
        group = file.require_group("inner")
        group["of_its_own"] = VALUES
        if kind == "storage":
            group.create_dataset("x", (60,), "<f4", external=[(str(tmp_path / "secret"), 0, 240)])
        elif kind == "virtual":
            layout = h5py.VirtualLayout(VALUES.shape, "<f4")
            layout[:] = h5py.VirtualSource(str(tmp_path / "other.nc"), "x", VALUES.shape)
            group.create_virtual_dataset("x", layout)
        elif kind == "filter":
            about = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
            about.set_chunk((10,))
            about.set_filter(32015, h5py.h5z.FLAG_OPTIONAL)
            h5py.h5d.create(group.id, b"x", h5py.h5t.IEEE_F32LE, h5py.h5s.create_simple((10,)), about)
        else:
            group["x"] = h5py.SoftLink("/x") if kind == "soft" else h5py.ExternalLink("other.nc", "x")
    for opened in (open_plain, open_decoded):
        with pytest.raises(NetcdfError, match=r"trace\.nc: inner/x: "), opened(tmp_path / "trace.nc"):
            pytest.fail("opened")


def test_no_more_is_read_than_fits(tmp_path):
    """10¹² numbers declared and none stored; and as a coordinate, which is read on opening."""
    path = tmp_path / "vast.nc"
    with h5py.File(path, "w") as file:
        file.create_dataset("elevation", (10**6, 10**6), "f8", chunks=(1000, 1000), compression="gzip")
    with open_decoded(path) as dataset:
        assert values(dataset["elevation"][:100, :100], "elevation").shape == (100, 100)
        with pytest.raises(NetcdfError, match=r"elevation: 8,000,000,000,000 bytes are asked for; at most"):
            values(dataset["elevation"], "elevation")
    with h5py.File(path, "w") as file:
        file.create_dataset("time", (10**12,), "f8", chunks=(1000,)).make_scale("time")
    with pytest.raises(NetcdfError, match=r"time: has 8,000,000,000,000 bytes"), open_decoded(path):
        pytest.fail("opened")
