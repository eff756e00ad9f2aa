"""Pictures for light and for dark pages: GitHub's `<picture>` in Markdown becomes two images of the theme furo."""

from __future__ import annotations

import re
from typing import Any

PICTURE = re.compile(
    r'<picture><source media="\(prefers-color-scheme: dark\)" srcset="([^"]+)">'
    r'<img alt="([^"]+)" src="([^"]+)"></picture>'
)
IMAGES = r"""```{image} \3
:alt: \2
:class: only-light
```

```{image} \1
:alt: \2
:class: only-dark
```"""


def convert(app: Any, page: str, source: list[str]) -> None:
    """Sphinx's event `source-read`."""
    source[0] = PICTURE.sub(IMAGES, source[0])


def setup(app: Any) -> dict[str, bool]:
    """Called by Sphinx."""
    app.connect("source-read", convert)
    return {"parallel_read_safe": True}
