"""Pictures as WebP without loss, as those of docs/images are: a third fewer octets than PNG.

python -m tests.support.webp docs/images runs/stuck/plot.png runs/stuck/timeline.png
"""

import sys
from io import BytesIO
from pathlib import Path

from PIL import Image


def as_webp(octets: bytes) -> bytes:
    """Return a picture as WebP, with the same pixels, but without transparency."""
    with Image.open(BytesIO(octets)) as picture:
        opaque = picture.convert("RGB")
    opaque.save(smaller := BytesIO(), format="webp", lossless=True, quality=100, method=6)
    return smaller.getvalue()


if __name__ == "__main__":
    folder, *pictures = map(Path, sys.argv[1:])
    for each in pictures:
        (folder / f"{each.stem}.webp").write_bytes(as_webp(each.read_bytes()))
