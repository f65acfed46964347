"""Show pictures at the size of their figures, with a link to all their pixels.

A figure of 7 inches is 700 CSS pixels wide, whatever its resolution, so that letters are of one size on all pages and
screens with two pixels per CSS pixel show every pixel of a file of 200 per inch. Narrower screens scale pictures down.
"""

from __future__ import annotations

from pathlib import Path

from docutils import nodes
from PIL import Image
from sphinx.application import Sphinx

from ruptfx.results import movies

PER_INCH = 100  # CSS pixels
RESOLUTIONS = {".webp": float(movies.RESOLUTION)}  # of files that do not name theirs [pixels per inch]
USUAL = 200.0


def width_of(path: Path) -> int:
    """Return the width of a picture on a page [CSS pixels]."""
    with Image.open(path) as picture:
        resolution = float(picture.info.get("dpi", (RESOLUTIONS.get(path.suffix, USUAL),))[0])
        return round(picture.width * PER_INCH / resolution)


def set_widths(app: Sphinx, document: nodes.document) -> None:
    """Give every picture its width; Sphinx links pictures with a width to their files."""
    for image in document.findall(nodes.image):
        path = Path(app.srcdir, image["uri"])  # the collector of images has made it relative to the folder of the site
        if "width" not in image and path.is_file() and path.suffix != ".svg" and not _in_table(image):
            image["width"] = f"{width_of(path)}px"


def _in_table(image: nodes.image) -> bool:
    """Return whether a picture is a thumbnail of a table, whose size the style sheet sets."""
    node = image.parent
    while node is not None and not isinstance(node, nodes.entry):
        node = node.parent
    return node is not None


def setup(app: Sphinx) -> dict[str, bool | int]:
    """Register the step in Sphinx."""
    app.connect("doctree-read", set_widths, priority=900)  # after the collector of images
    return {"parallel_read_safe": True, "parallel_write_safe": True, "env_version": 1}
