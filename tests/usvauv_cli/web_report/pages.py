"""What tests of HTML pages share: their elements, that they need nothing else, and what they do in a browser."""

import html
import json
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
WATCH = """<script>
const problems = [];
addEventListener("error", (event) => problems.push(String(event.message)));
addEventListener("securitypolicyviolation", (event) => problems.push(`${event.violatedDirective} ${event.blockedURI}`));
for (const name of ["error", "warn"]) console[name] = (...words) => problems.push(words.join(" "));
</script>"""
TRY = """<script>
addEventListener("load", async () => {
  const answer = await (async () => { TRY })();
  const wide = document.documentElement.scrollWidth, inner = innerWidth;
  parent.postMessage(JSON.stringify({ ...answer, problems, wide, inner }), "*");
});
</script>"""
FRAME = """<!DOCTYPE html><body><pre></pre><script>
addEventListener("message", (event) => { document.querySelector("pre").textContent = event.data; });
</script><iframe src="page.html" style="border:0;width:WIDTHpx;height:800px"></iframe>"""


class Elements(HTMLParser):
    """Every element of a page with its attributes, and the rows of its tables as lists of texts."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.tables: list[list[list[str]]] = []
        self.cell = False
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))
        if tag == "table":
            self.tables.append([])
        elif tag == "tr":
            self.tables[-1].append([])
        elif tag in ("th", "td"):
            self.tables[-1][-1].append("")
            self.cell = True
        elif tag == "br" and self.cell:
            self.tables[-1][-1][-1] += "\n"

    def handle_endtag(self, tag):
        if tag in ("th", "td"):
            self.cell = False

    def handle_data(self, data):
        if self.cell:
            self.tables[-1][-1][-1] += data


def check_alone(folder: Path) -> None:
    """The page of a folder needs nothing but itself; it links to PDFs that are there, and its ids are there once."""
    text = (folder / "index.html").read_text(encoding="utf-8")
    found = Elements(text).found
    for tag, attributes in found:
        assert tag not in ("link", "iframe", "object", "embed", "base", "img")
        for name in ("src", "href", "xlink:href", "action"):
            target = attributes.get(name) or "#"
            local = target.removesuffix(".pdf")
            assert target.startswith("#") or (tag == "a" and (folder / f"{local}.pdf").is_file()), target
    assert "@import" not in text
    assert set(re.findall(r"url\((.)", text)) <= {"#"}
    assert "default-src 'none'" in html.unescape(text)
    ids = [attributes["id"] for _, attributes in found if "id" in attributes]
    assert len(ids) == len(set(ids))
    named = [attributes.get(name) or "" for _, attributes in found for name in ("href", "xlink:href", "clip-path")]
    referred = {match[1] for text in named if (match := re.search(r"#([\w-]+)", text))}
    assert referred
    assert referred <= set(ids)


def check_figures(folder: Path, names: set[str]) -> None:
    """The figures of a page are described and follow the theme; their PDFs are a column wide, with fonts, undated."""
    text = (folder / "index.html").read_text(encoding="utf-8")
    drawn = re.findall(r"<svg viewBox[^>]*role=\"img\".*?</svg>", text, re.DOTALL)
    assert len(drawn) == len(names)
    for svg in drawn:
        title, about = (re.search(rf"<{tag} id=\"([\w-]+)\">([^<]+)</{tag}>", svg) for tag in ("title", "desc"))
        assert f'aria-labelledby="{title[1]} {about[1]}"' in svg
        assert re.findall(r"#[0-9a-f]{6}\b", svg) == []
    files = list(folder.glob("*.pdf"))
    assert {path.stem for path in files} == names
    for path in files:
        content = path.read_bytes()
        assert b"/MediaBox [ 0 0 244.8 " in content
        assert b"CreationDate" not in content
        assert b"/Type3" not in content
        assert content.count(b"/FontFile2") == content.count(b"/Type /FontDescriptor") > 0


def in_browser(text: str, folder: Path, width: int, script: str = "") -> dict[str, Any]:
    """What a function of this body says of the page in Chromium, in a window of that width, where nothing is wrong."""
    tried = text.replace("<head>", f"<head>{WATCH}").replace("</body>", TRY.replace("TRY", script) + "</body>")
    (folder / "page.html").write_text(tried, encoding="utf-8")
    (folder / "frame.html").write_text(FRAME.replace("WIDTH", str(width)), encoding="utf-8")
    options = ["--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={folder / 'profile'}"]
    window = ["--window-size=1400,900", "--virtual-time-budget=10000", "--dump-dom"]
    assert CHROMIUM
    done = subprocess.run(
        [CHROMIUM, *options, *window, f"file://{folder}/frame.html"],
        capture_output=True, text=True, check=False, timeout=120,
    )  # fmt: skip
    answer = json.loads(html.unescape(re.search(r"<pre>(.*?)</pre>", done.stdout, re.DOTALL)[1]))
    assert answer["problems"] == []
    assert answer["inner"] == width
    assert answer["wide"] <= width
    return answer
