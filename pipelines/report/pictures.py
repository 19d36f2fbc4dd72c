"""Pictures in a report page: embedded, single, and in pairs with a divider."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping
from html import escape

import numpy as np
from numpy.typing import NDArray
from PIL import Image

UInt8 = NDArray[np.uint8]


def pair(sources: Mapping[str, str], names: tuple[str, ...], tags: tuple[str, ...], caption: str) -> str:
    """Two pictures over each other, a divider that can be dragged, and a button to blink between them."""
    (left, right), (left_tag, right_tag) = names, tags
    label = escape(f"Divider between {left_tag} and {right_tag}", quote=True)
    return (
        f'<figure><div class="pair"><img src="{sources[left]}" alt="{escape(left_tag)}">'
        f'<img class="over" src="{sources[right]}" alt="{escape(right_tag)}">'
        f'<input type="range" min="0" max="100" step="0.1" value="50" aria-label="{label}">'
        f'<div class="edge"></div><span class="tag left">{escape(left_tag)}</span>'
        f'<span class="tag right">{escape(right_tag)}</span></div>'
        f'<figcaption>{escape(caption)} <button type="button" class="blink">Blink</button></figcaption>'
        "</figure>"
    )


def single(source: str, caption: str) -> str:
    """One picture with a line below it."""
    return (
        f'<figure><img src="{source}" alt="{escape(caption, quote=True)}">'
        f"<figcaption>{escape(caption)}</figcaption></figure>"
    )


def data_uri(pixels: UInt8, quality: int | None = None) -> str:
    """sRGB pixels (h, w, 3) as the address of an embedded PNG, or of a JPEG of this quality, up to 100."""
    stream, image = io.BytesIO(), Image.fromarray(np.ascontiguousarray(pixels[..., :3]))
    if quality is None:
        image.save(stream, format="PNG", optimize=True)
    else:
        image.save(stream, format="JPEG", quality=quality, subsampling=0)
    kind = "png" if quality is None else "jpeg"
    return f"data:image/{kind};base64," + base64.b64encode(stream.getvalue()).decode("ascii")
