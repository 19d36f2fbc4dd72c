"""Files: what an EXR and a PNG hold, that writes are whole, and the tone curves against the GPU."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from runtime.encoder import Recorder
from runtime.images import ImageError, area_resample, encode, read_image, read_layers, write_exr, write_png
from runtime.resources import Texture
from runtime.settings import RenderSettings, ToneCurve
from runtime.views import ToneMap, to_display


def test_exr_holds_linear_float32_with_named_channels(tmp_path):
    rng = np.random.default_rng(0)
    picture = (rng.random((5, 7, 3)) * 1e5).astype(np.float32)
    layers = {
        "position": rng.normal(size=(5, 7, 3)).astype(np.float32),
        "depth": rng.random((5, 7, 3)).astype(np.float32),
        "direct": rng.random((5, 7, 3)).astype(np.float32),
    }
    write_exr(tmp_path / "a.exr", picture, layers)
    pixels, names = read_layers(tmp_path / "a.exr")
    planes = dict(zip(names, np.moveaxis(pixels, -1, 0), strict=True))
    positions, directs = [f"position.{c}" for c in "XYZ"], [f"direct.{c}" for c in "RGB"]
    assert set(names) == {*"RGB", *positions, "depth.Z", *directs}
    np.testing.assert_array_equal(np.stack([planes[c] for c in "RGB"], -1), picture)
    np.testing.assert_array_equal(planes["position.Y"], layers["position"][..., 1])
    np.testing.assert_array_equal(planes["depth.Z"], layers["depth"][..., 0])
    np.testing.assert_array_equal(planes["direct.B"], layers["direct"][..., 2])


def test_row_0_is_on_top(tmp_path):
    picture = np.zeros((3, 2, 3), np.float32)
    picture[0] = 1.0
    write_exr(tmp_path / "a.exr", picture)
    write_png(tmp_path / "a.png", encode(picture))
    import OpenImageIO as oiio

    source = oiio.ImageInput.open(str(tmp_path / "a.exr"))
    assert source.read_scanline(0, 0, oiio.FLOAT).min() == 1.0
    source.close()
    np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / "a.png"))[:, 0, 0], [255, 0, 0])


def test_radiance_hdr_is_read(tmp_path):
    import OpenImageIO as oiio

    picture = np.array([[[0.5, 1.0, 2.0], [100.0, 50.0, 25.0]]], np.float32)
    output = oiio.ImageOutput.create("hdr")
    assert output.open(str(tmp_path / "a.hdr"), oiio.ImageSpec(2, 1, 3, oiio.FLOAT))
    output.write_image(picture)
    output.close()
    np.testing.assert_allclose(read_image(tmp_path / "a.hdr"), picture, rtol=1 / 128)


def test_bad_files_are_named(tmp_path):
    with pytest.raises(ImageError, match=r"no\.exr: there is no such file"):
        read_image(tmp_path / "no.exr")
    (tmp_path / "bad.exr").write_bytes(b"no picture at all")
    with pytest.raises(ImageError, match=r"bad\.exr: cannot be read"):
        read_image(tmp_path / "bad.exr")
    with pytest.raises(ImageError, match="no folder"):
        write_png(tmp_path / "none" / "a.png", np.zeros((2, 2, 3), np.uint8))
    with pytest.raises(ImageError, match="uint8"):
        write_png(tmp_path / "a.png", np.zeros((2, 2, 3)))  # type: ignore[arg-type]


def test_a_failed_write_leaves_the_old_file_and_no_rest(tmp_path):
    picture = np.ones((2, 2, 3), np.float32)
    write_exr(tmp_path / "a.exr", picture)
    with pytest.raises(ImageError, match="layer direct is"):
        write_exr(tmp_path / "a.exr", picture * 2, {"direct": np.zeros((3, 3, 3), np.float32)})
    assert [p.name for p in tmp_path.iterdir()] == ["a.exr"]
    np.testing.assert_array_equal(read_image(tmp_path / "a.exr"), picture)


def test_exposure_and_curves():
    """18 % grey, one stop, and the ends of each curve."""
    grey = np.full((1, 1, 3), 0.18, np.float32)
    assert encode(grey)[0, 0, 0] == 118
    assert encode(grey, exposure=1.0)[0, 0, 0] == encode(grey * 2)[0, 0, 0] == 162
    assert encode(np.full((1, 1, 3), 1.0), 0.0, ToneCurve.REINHARD)[0, 0, 0] == 188
    for curve in ToneCurve:
        ramp = encode(np.geomspace(1e-4, 1e6, 200)[:, None] * np.ones(3), 0.0, curve)[:, 0].astype(int)
        assert np.all(np.diff(ramp) >= 0) and ramp[0] == 0 and ramp[-1] == 255
        assert encode(np.array([[-1.0, 0.0, 0.0]]), 0.0, curve).max() == 0


@pytest.mark.parametrize("curve", list(ToneCurve))
def test_gpu_and_cpu_show_the_same_picture(gpu, curve):
    values = np.geomspace(1e-4, 1e5, 64 * 8 * 3).reshape(8, 64, 3)
    radiance = Texture(
        gpu, (64, 8), "rgba32float", data=np.concatenate([values, np.ones((8, 64, 1))], -1).astype(np.float32)
    )
    tone_map = ToneMap(gpu, (64, 8), -1.5, curve)
    rec = Recorder(gpu)
    tone_map.record(rec, radiance)
    rec.submit()
    shown = tone_map.picture.read()[..., :3].astype(int)
    assert np.abs(shown - encode(values, -1.5, curve)).max() <= 1


def test_area_resample_keeps_the_mean_and_constant():
    values = np.random.default_rng(5).random((7, 3))
    for count in (1, 2, 3, 5, 7):
        shrunk = area_resample(values, 0, count)
        assert shrunk.shape == (count, 3)
        np.testing.assert_allclose(shrunk.mean(0), values.mean(0), rtol=1e-12)
    np.testing.assert_allclose(area_resample(np.ones(5), 0, 3, np.square), 1.0, rtol=1e-12)
    weighted = area_resample(np.array([1.0, 5.0]), 0, 1, np.square)
    np.testing.assert_allclose(weighted, 1 * 0.25 + 5 * 0.75)
    np.testing.assert_allclose(area_resample(np.array([1.0, 2, 3]), 0, 2), [(1 + 1) / 1.5, (1 + 3) / 1.5])


def test_every_data_view_has_a_picture():
    rng = np.random.default_rng(6)
    settings = RenderSettings()
    from runtime.views import VIEWS

    for view in VIEWS:
        pixels = rng.normal(size=(4, 5, 3)).astype(np.float32)
        shown = to_display(view, pixels, settings)
        assert shown.shape == (4, 5, 3) and shown.dtype == np.uint8
        assert to_display(view, np.zeros_like(pixels), settings).std(axis=(0, 1)).max() == 0
    up = to_display("normal", np.array([[[0, 1, 0]]], np.float32), settings)
    np.testing.assert_array_equal(up[0, 0], [128, 255, 128])
