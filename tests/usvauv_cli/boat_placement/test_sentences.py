"""Sentences of real systems: where their fields are, and which of them say that there is no good fix."""

import math
from functools import reduce

import pytest

from usvauv.cli.boat_placement.fixes import BadLine, NoFix
from usvauv.cli.boat_placement.ship_log import Boat, Geographic, Heading, Relative, parse


def signed(body: str) -> str:
    return f"${body}*{reduce(lambda total, byte: total ^ byte, body.encode(), 0):02X}"


class TestSentences:
    @pytest.mark.parametrize(
        ("line", "said"),
        [
            # As in PosiView's description of Ranger 2, and as logged from a submersible: with their checksums.
            (
                "$PSONLLD,153005.253,24,A,50.02495,8.873323,425.3,,,,,,,,*3e",
                Geographic(55805.253, "24", 50.02495, 8.873323, 425.3),
            ),
            (
                'log "$PSONLLD,170004.53,ALVIN 914,A,28.8114807,-87.80925696,1951.156,13.96,13.96,0.00,2.62,,,,*6F" 1',
                Geographic(61204.53, "ALVIN 914", 28.8114807, -87.80925696, 1951.156),
            ),
            # The example of NavDP's manual, whose checksum is not its own.
            (
                "$PSIMSSB,085405.61,B42,A,,C,H,M,134.5,114.5,120.0,,,,",
                Relative(32045.61, "B42", 134.5, 114.5, 120, True),
            ),
            (signed("PSIMSSB,000001.00,B01,A,,C,N,F,3.0,4.0,9.0,0.1,N,,"), Relative(1, "B01", 4, 3, 9)),
            (signed("PSIMSSB,000001.00,B01,A,,C,E,F,3.0,4.0,9.0,0.1,N,,"), Relative(1, "B01", 3, 4, 9)),
            (
                signed("PTSAG,#00012,101500.500,03,06,2019,02,5001.5000,N,00852.2500,W,F,0301.5,1,9999.0"),
                Geographic(36900.5, "02", 50.025, -8.87083333333, 301.5),
            ),
            (
                "+++AT:103:USBLLONG,1458.79,1457.31,3,1.0,2.0,-30.0,12.5,-7.25,-31.0,0.01,0.02,1.5,20500,-25,190,0.03",
                Relative(1457.31, "3", 12.5, -7.25, 31, said=1458.79),
            ),
            (
                signed("PTSAG,#00012,101500.500,03,06,2019,00,5001.5000,N,00852.2500,E,F,0005.8,1,9999.0"),
                Geographic(36900.5, "00", 50.025, 8.87083333333, 5.8, True),
            ),
            (
                signed("INGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,"),
                Boat(45319, 48.1173, 11.5166666667),
            ),
            (signed("HEHDT,90.0,T"), Heading(math.pi / 2)),
        ],
    )
    def test_fields_are_where_the_maker_says(self, line, said):
        found = parse(line)
        assert type(found) is type(said)
        assert found == pytest.approx(said) if isinstance(said, Boat | Heading) else True
        for value, expected in zip(found, said, strict=True):
            assert value == (expected if isinstance(expected, str | None) else pytest.approx(expected, abs=1e-9))

    @pytest.mark.parametrize(
        "line",
        [
            "",
            "# started",
            signed("GPVTG,0.0,T,,M,0.0,N,0.0,K"),
        ],
    )
    def test_other_lines_are_passed_over(self, line):
        assert parse(line) is None

    @pytest.mark.parametrize(
        ("body", "reason"),
        [
            ("PSONLLD,153005.253,24,V,50.02495,8.873323,425.3,,,,,,,,", "status 'V'"),
            ("PSONLLD,153005.253,24,A,0.0,0.0,425.3,,,,,,,,", "latitude and longitude 0"),
            ("PSIMSSB,000001.00,B01,A,NRy,C,N,F,13.2,-1.9,0.4,2.2,T,0.008,", "error code 'NRy'"),
            ("PSIMSSB,000001.00,B01,A,,C,N,P,3.0,4.0,9.0,0.1,N,,", "predicted"),
            ("PTSAG,#00012,101500.500,03,06,2019,02,5001.5,N,00852.25,W,0,0301.5,1,9999.0", "position validity '0'"),
            ("PTSAG,#00012,101500.500,03,06,2019,02,5001.5,N,00852.25,W,F,0301.5,0,9999.0", "depth validity '0'"),
            ("PTSAG,#00012,101500.500,03,06,2019,02,5001.5,N,00852.25,W,F,0301.5,2,9999.0", "depth 9999"),
            ("PTSAG,#00012,101500.500,03,06,2019,-4,5001.5,N,00852.25,W,F,0301.5,1,9999.0", "unknown transponder"),
            ("+AT:103:USBLLONG,8,7,3,1,2,-30,12,-7,-31,0,0,1,20500,-25,90,0.03", "integrity below 100"),
            ("+AT:103:USBLLONG,8,7,3,1,2,-30,12,-7,-31,0,0,1,20500,-25,190,-1", "accuracy below 0"),
            ("GPGGA,123519,4807.038,N,01131.000,E,0,08,0.9,545.4,M,46.9,M,,", "position of quality '0'"),
        ],
    )
    def test_what_is_no_good_fix_by_its_makers_fields(self, body, reason):
        with pytest.raises(NoFix, match=reason):
            parse(body if body.startswith("+") else signed(body))

    @pytest.mark.parametrize(
        ("line", "problem"),
        [
            ("$PSONLLD,153005.253,24,A,50.02496,8.873323,425.3,,,,,,,,*3e", "checksum 3e, the sentence has 3D"),
            ("$PSONLLD,153005.253,24,A,50.02495,8.873323,425.3,,,,,,,,", "no checksum"),
            (signed("PSONLLD,153005.253,24,A,50.02495,,425.3,,,,,,,,"), "a field is missing"),
            (signed("PSONLLD,153005.253,24,A,nan,8.8,425.3,,,,,,,,"), "a field is missing"),
            (signed("PSIMSSB,000001.00,B01,A,,U,E,F,3.0,4.0,9.0,0.1,N,,"), "coordinates U, orientation E"),
            ("+AT:103:USBLLONG,8,7,3,1,2,-30,12,-7,-31", "a field is missing"),  # cut, perhaps in a number
            (signed("PSIMSSB,250001.00,B01,A,,C,N,F,3.0,4.0,9.0,0.1,N,,"), "a field is missing"),
            (signed("HEHDT,400.0,T"), "heading 400: allowed is 0 to 360"),
            (signed("PSONLLD,153005.253,24,A,95.0,8.8,425.3,,,,,,,,"), "latitude 95, longitude 8.8: allowed are ±90"),
        ],
    )
    def test_what_is_wrong_with_a_line(self, line, problem):
        with pytest.raises(BadLine, match=problem):
            parse(line)
