"""The sky's orientation, filtering and energy, on the CPU and through a picture of the background."""

from __future__ import annotations

import numpy as np
import pytest

from runtime.camera import look_at
from runtime.images import write_exr
from runtime.sky import Sky, resample_sky, sky_pyramid

COMPASS = {
    "zenith": ((0, 1, 0), 0.0, 0.0),
    "ahead, -z": ((0, 0, -1), 0.0, 0.5),
    "right, +x": ((1, 0, 0), 0.25, 0.5),
    "behind, +z": ((0, 0, 1), 0.5, 0.5),
    "left, -x": ((-1, 0, 0), 0.75, 0.5),
}


def spheres(picture):
    """Integral over the sphere (3,) of an equirectangular picture."""
    rows = np.arange(picture.shape[0] + 1) / picture.shape[0] * np.pi
    solid_angle = -np.diff(np.cos(rows)) * 2 * np.pi / picture.shape[1]
    return (picture * solid_angle[:, None, None]).sum(axis=(0, 1), dtype=np.float64)


def compass_picture(height=64):
    """Each pixel holds its own direction's (u, v, 1)."""
    v, u = np.meshgrid(
        (np.arange(height) + 0.5) / height, (np.arange(2 * height) + 0.5) / (2 * height), indexing="ij"
    )
    return np.stack([u, v, np.ones_like(u)], -1).astype(np.float32)


@pytest.mark.parametrize("name", COMPASS)
def test_orientation(name):
    direction, u, v = COMPASS[name]
    seen = Sky.from_picture(compass_picture()).radiance(np.array([direction], float))[0]
    distance = abs(seen[0] - u)
    if name not in ("zenith", "ahead, -z"):  # there u is any or wraps around
        assert distance < 1e-6
    assert seen[1] == pytest.approx(v, abs=0.01)


def test_the_background_shows_the_file(builder, render_scene, tmp_path):
    """A known pixel of an EXR, seen through cameras that look at it: all four compass points, each its own
    colour."""
    picture = np.zeros((16, 32, 3), np.float32)
    for k, name in enumerate(["ahead, -z", "right, +x", "behind, +z", "left, -x"]):
        column = round(COMPASS[name][1] * 32)
        picture[7:9, [column - 1, column]] = np.eye(4, 3)[k] * 5 + 1
    write_exr(tmp_path / "sky.exr", picture)
    sky = Sky.from_file(tmp_path / "sky.exr")
    np.testing.assert_array_equal(sky.picture, picture)
    builder.quad((100, 100, 100), (1, 0, 0), (0, 1, 0))
    scene = builder.scene()
    for k, name in enumerate(["ahead, -z", "right, +x", "behind, +z", "left, -x"]):
        camera = look_at(np.zeros(3), np.array(COMPASS[name][0], float), fov=2.0)
        images = render_scene(
            scene, camera, size=(16, 16), sky=sky, only=("final", "indirect", "direct")
        ).images
        np.testing.assert_allclose(images["final"][8, 8], np.eye(4, 3)[k] * 5 + 1, rtol=1e-4)
        np.testing.assert_array_equal(images["indirect"], images["final"])
        assert not images["direct"].any()


def test_background_matches_the_twin(builder, render_scene):
    """Every pixel of wide views, across the seam and the poles, picture and gradient alike."""
    rng = np.random.default_rng(3)
    builder.quad((100, 100, 100), (1, 0, 0), (0, 1, 0))
    scene = builder.scene()
    skies = [
        Sky.from_picture(rng.random((8, 16, 3)).astype(np.float32)),
        Sky.gradient((1, 2, 3), (0.5, -2.5, 1), (1, 1, -0.5)),
        Sky.constant((0.25, 0.5, 1.0)),
    ]
    for sky in skies:
        for target in ((0.1, 0.2, -1), (0.05, 1, 0.02), (0.3, -1, 0.5)):
            camera = look_at(np.zeros(3), np.array(target), fov=100.0)
            image = render_scene(scene, camera, size=(32, 24), sky=sky).images["final"]
            x, y = np.meshgrid((np.arange(32) + 0.5) / 16 - 1, 1 - (np.arange(24) + 0.5) / 12)
            slope = np.tan(np.radians(50))
            local = np.stack([x * slope * 32 / 24, y * slope, -np.ones_like(x)], -1).reshape(-1, 3)
            directions = local @ camera.world_from_local[:3, :3].T
            expected = sky.radiance(directions / np.linalg.norm(directions, axis=1, keepdims=True))
            np.testing.assert_allclose(image.reshape(-1, 3), expected, atol=2e-4 * expected.max())


def test_downsampling_keeps_the_energy():
    """A sun of one pixel near the horizon and noise at the poles, to sizes that do not divide."""
    rng = np.random.default_rng(4)
    picture = rng.random((50, 100, 3)).astype(np.float32)
    picture[20, 70] = 1e5
    for width, height in ((64, 32), (33, 17), (7, 3), (1, 1)):
        np.testing.assert_allclose(spheres(resample_sky(picture, width, height)), spheres(picture), rtol=1e-5)
    for level in sky_pyramid(picture):
        np.testing.assert_allclose(spheres(level), spheres(picture), rtol=1e-5)
    small = Sky.from_picture(picture, max_width=40)
    assert small.picture.shape == (20, 40, 3)
    np.testing.assert_allclose(spheres(small.picture), spheres(picture), rtol=1e-5)


def test_broken_texels_become_dark():
    picture = np.ones((4, 8, 4), np.float32)
    picture[0, 0, :3] = [np.nan, np.inf, -1.0]
    sky = Sky.from_picture(picture)
    assert sky.picture.shape == (4, 8, 3)
    np.testing.assert_array_equal(sky.picture[0, 0], 0)


def test_scaled_and_described():
    sky = Sky.gradient((1, 1, 1), (0.5, 0, 0), (0, 2, 0)).scaled(2.0)
    np.testing.assert_allclose(sky.radiance(np.array([[0, 1.0, 0]])), [[3, 2, 2]])
    assert sky.describe().startswith("gradient sky")
    assert Sky().is_black and Sky().describe() == "no sky"
    assert "8 x 4" in Sky.from_picture(np.ones((4, 8, 3), np.float32)).describe()
