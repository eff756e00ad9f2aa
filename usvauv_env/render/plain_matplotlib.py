# ruff: noqa: E402, F401 (names for others, from a library that is imported below)
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
        from unittest.mock import patch

        own = patch.dict(os.environ, MPLBACKEND="", MATPLOTLIBRC=os.devnull)
        with own, contextlib.chdir(Path(__file__).parent):  # a matplotlibrc in the folder goes before all others
            importlib.import_module("matplotlib")
    finally:
        logger.setLevel(level)


_import_matplotlib()

# The names are for others.
import matplotlib
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.ft2font import FT2Font
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse
from matplotlib.patheffects import AbstractPathEffect, withStroke
from matplotlib.ticker import FixedLocator, FormatStrFormatter, LogFormatter, MaxNLocator, NullLocator

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
