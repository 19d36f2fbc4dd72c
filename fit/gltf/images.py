"""PNG, JPEG, WebP and AVIF bytes -> (height, width, 4) uint8."""

from __future__ import annotations

import io
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from PIL import Image as PillowImage
from PIL import UnidentifiedImageError

from fit.gltf.json_object import JsonObject
from fit.scene import Image, UInt8

MAX_PIXELS = 8192 * 8192
"""Pixels of one image; decoded it takes four bytes each. Below Pillow's own alarm."""

MAX_TOTAL_PIXELS = 8 * MAX_PIXELS
"""Pixels of all images of one file; 2 GiB decoded."""

FORMATS = ("PNG", "JPEG", "WEBP", "AVIF")
KTX2_MAGIC = b"\xabKTX 20\xbb\r\n\x1a\n"


@dataclass(frozen=True)
class EncodedImage:
    """An image as the file stores it."""

    definition: JsonObject
    name: str
    data: bytes | memoryview


def can_decode(name: str) -> bool:
    """Whether this Pillow reads the format `name` ("WEBP")."""
    PillowImage.init()
    return name in PillowImage.OPEN


def is_ktx2(image: EncodedImage) -> bool:
    return bytes(image.data[: len(KTX2_MAGIC)]) == KTX2_MAGIC


def decode_images(encoded: Sequence[EncodedImage]) -> tuple[Image, ...]:
    """Decode all images, in parallel: Pillow releases the interpreter while it decodes.

    Raises:
        GltfError: an image is damaged, of another format, or absurdly large.
    """
    _check_sizes(encoded)
    with ThreadPoolExecutor(max_workers=min(8, os.cpu_count() or 1)) as pool:
        pixels = list(pool.map(_decode, encoded))
    return tuple(Image(image.name, values) for image, values in zip(encoded, pixels, strict=True))


def _check_sizes(encoded: Sequence[EncodedImage]) -> None:
    total = 0
    for image in encoded:
        with _open(image) as opened:
            width, height = opened.size
        total += width * height
        if width * height > MAX_PIXELS or total > MAX_TOTAL_PIXELS:
            what = f"{width} x {height} pixels are too many; shrink it with `npx @gltf-transform/cli resize`"
            raise image.definition.error(what)


def _open(image: EncodedImage) -> PillowImage.Image:
    formats = [name for name in FORMATS if can_decode(name)]
    try:
        return PillowImage.open(io.BytesIO(image.data), formats=formats)
    except UnidentifiedImageError as error:
        what = f"{image.name!r} is not a PNG, JPEG, WebP or AVIF image; convert it to PNG"
        raise image.definition.error(what) from error
    except Exception as error:  # Pillow's decoders raise many kinds on damaged headers
        raise _damaged(image, error) from error


def _decode(image: EncodedImage) -> UInt8:
    try:
        with _open(image) as opened:
            return _to_rgba(opened)
    except (OSError, SyntaxError, EOFError, IndexError, TypeError, ZeroDivisionError, MemoryError) as error:
        raise _damaged(image, error) from error


def _to_rgba(opened: PillowImage.Image) -> UInt8:
    if opened.mode.startswith("I"):  # 16-bit grey; Pillow would clip it to 255 instead of scaling
        wide = np.asarray(opened).astype(np.int64)
        grey = np.clip((wide * 255 + 32767) // 65535, 0, 255).astype(np.uint8)
        return np.stack([grey, grey, grey, np.full_like(grey, 255)], axis=2)
    return np.array(opened.convert("RGBA"))


def _damaged(image: EncodedImage, error: BaseException) -> Exception:
    return image.definition.error(f"{image.name!r} can't be decoded ({error}); replace the image")
