"""matplotlib for all figures, which do not depend on the settings of whoever makes them: see `plain`.

Its names are imported from here, since `import matplotlib` fails where MPLBACKEND names a backend that is not
installed, as Jupyter's does in another environment, and where a matplotlibrc cannot be read.
"""

from __future__ import annotations

import contextlib
import importlib
import logging
import os
import sys
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any


def _import_matplotlib() -> None:
    """Import matplotlib with the settings of its user, or, where they cannot be used, with its own."""
    logger = logging.getLogger("matplotlib")  # which warns of each line of a matplotlibrc that it does not know
    level = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        importlib.import_module("matplotlib")
    except ImportError:
        raise
    except Exception:  # of any kind, by what is wrong with the settings
        for name in [name for name in sys.modules if name.startswith("matplotlib.")]:
            del sys.modules[name]  # parts of the module that was not made
        names = ("MPLBACKEND", "MATPLOTLIBRC")
        given = {name: os.environ[name] for name in names if name in os.environ}
        os.environ |= dict(zip(names, ("", os.devnull), strict=True))
        try:
            with contextlib.chdir(Path(__file__).parent):  # a matplotlibrc in the folder goes before all others
                importlib.import_module("matplotlib")
        finally:
            for name in names:
                del os.environ[name]
            os.environ |= given
    finally:
        logger.setLevel(level)


_import_matplotlib()

# The names are for others too.
import matplotlib  # noqa: E402
from matplotlib.axes import Axes  # noqa: E402
from matplotlib.axis import Axis  # noqa: E402
from matplotlib.cm import ScalarMappable  # noqa: E402
from matplotlib.colors import LinearSegmentedColormap, Normalize  # noqa: E402
from matplotlib.figure import Figure  # noqa: E402
from matplotlib.ft2font import FT2Font  # noqa: E402
from matplotlib.lines import Line2D  # noqa: E402
from matplotlib.patches import Ellipse  # noqa: E402
from matplotlib.patheffects import AbstractPathEffect, withStroke  # noqa: E402
from matplotlib.ticker import FixedLocator, FormatStrFormatter, LogFormatter, MaxNLocator, NullLocator  # noqa: E402

__all__ = [
    "AbstractPathEffect",
    "Axes",
    "Axis",
    "Ellipse",
    "FT2Font",
    "Figure",
    "FixedLocator",
    "FormatStrFormatter",
    "Line2D",
    "LinearSegmentedColormap",
    "LogFormatter",
    "MaxNLocator",
    "Normalize",
    "NullLocator",
    "ScalarMappable",
    "font",
    "matplotlib",
    "plain",
    "withStroke",
]

DEFAULTS: dict[Any, Any] = {name: value for name, value in matplotlib.rcParamsDefault.items() if name != "backend"}
DEFAULTS["text.parse_math"] = False


@contextlib.contextmanager
def plain(settings: Mapping[Any, Any] | None = None) -> Iterator[None]:
    """Settings in which a figure is made and saved: matplotlib's own ones but for those given.

    Text is drawn as it stands: names hold dollars, underscores and braces that are no mathematics, and letters that the
    font lacks, each of which matplotlib would warn of again and again.
    """
    with matplotlib.rc_context(DEFAULTS | dict(settings or {})), warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"Glyph \d+ |Matplotlib currently does not support .* natively", UserWarning)
        yield


def font(name: str) -> FT2Font:
    """One of the fonts that matplotlib installs, by the name of its file."""
    return FT2Font(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / name))
