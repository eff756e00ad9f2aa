"""Packages import downwards only, rooms and modules not in circles, and Taichi is imported by the kernels alone."""

import subprocess
import sys

from tests.import_graph import PACKAGES, ROOT, circle, imported, mermaid, module_graph, reduced, room_graph, sources

MODULES = module_graph()


def test_no_import_leads_upwards():
    def floor(name: str) -> int:
        return PACKAGES.index(name.partition(".")[0])

    upwards = [(name, target) for name, targets in MODULES.items() for target in targets if floor(target) > floor(name)]
    assert upwards == []


def test_only_kernels_import_taichi():
    importers = {
        name.partition(".")[0]
        for name, path in sources().items()
        for target in imported(path)
        if target.partition(".")[0] == "taichi"
    }
    assert importers == {"kernels"}


def test_what_reads_no_netcdf_loads_no_library_for_it():
    code = "import sys, policies, usvauv_env, usvauv_cli.mission_video as _; print({'xarray', 'h5py'} & {*sys.modules})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.splitlines()[-1] == "set()"


def test_no_circle_of_modules():
    assert circle(MODULES) == []


def test_no_circle_of_rooms():
    assert circle(room_graph(MODULES)) == []


def test_contributing_shows_the_graph():
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    assert f"```mermaid\n{mermaid(room_graph(MODULES))}\n```" in text, "see `python -m tests.import_graph`"


class TestGraph:
    """The functions that the tests above stand on, on graphs whose answer is known."""

    def test_a_circle_is_found_wherever_it_is(self):
        line = {"a": {"b", "c"}, "b": {"c"}, "c": set()}
        assert circle(line) == []
        assert sorted(circle({**line, "c": {"b"}})) == ["b", "c"]
        assert circle({**line, "c": {"c"}}) == ["c"]

    def test_imports_are_found_wherever_they_stand(self, tmp_path):
        path = tmp_path / "module.py"
        path.write_text("import a.b\nif True:\n    from c import d as e, f\ndef g():\n    class H:\n        import i\n")
        assert sorted(imported(path)) == ["a.b", "c.d", "c.f", "i"]

    def test_reduction_keeps_what_follows_from_nothing_else(self):
        assert reduced({"a": {"b", "c", "d"}, "b": {"c"}, "c": {"d"}, "d": set()}) == {
            "a": {"b"},
            "b": {"c"},
            "c": {"d"},
            "d": set(),
        }
