"""Contents of damaged files."""

from __future__ import annotations

import random
from collections.abc import Iterator


def damaged(whole: bytes, count: int, most: int, seed: int) -> Iterator[bytes]:
    """Yield `count` contents with up to `most` wrong bytes; every fifth is cut off, every fiftieth is noise."""
    rng = random.Random(seed)
    for number in range(count):
        content = bytearray(whole)
        for _ in range(rng.randint(0, most)):
            content[rng.randrange(len(content))] = rng.randrange(256)
        result = bytes(content[: rng.randrange(len(content))] if number % 5 == 0 else content)
        yield rng.randbytes(300) if number % 50 == 0 else result
