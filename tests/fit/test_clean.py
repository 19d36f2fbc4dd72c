"""Meshes mended by MeshLab: what lids and the wrap leave of a body, at any size."""

import builtins
from pathlib import Path

import numpy as np
import pytest
import trimesh

from fit import clean as mending
from fit.air import find_air
from fit.clean import NoMeshLab, close_holes, load_meshlab, wrap
from fit.scene import Instance, Material, Mesh, Scene
from fit.settings import FitSettings
from fit.solid import find_solid, missing_repair
from fit.solve import fit
from fit.surface import from_triangles
from fit.volume import NotClosed, mesh_solid


@pytest.fixture(scope="module")
def meshlab():
    """Skips where pymeshlab can't be loaded; the reason is the remedy."""
    try:
        return load_meshlab()
    except NoMeshLab as why:
        pytest.skip(str(why))


@pytest.fixture
def without_meshlab(monkeypatch):
    """Makes the import of pymeshlab fail with an error."""

    def make(error):
        def refuse(name, *args, **kwargs):
            if name == "pymeshlab":
                raise error
            return real(name, *args, **kwargs)

        monkeypatch.setattr(builtins, "__import__", refuse)

    real = builtins.__import__
    return make


def ball(radius=1.0, subdivisions=3):
    return np.array(trimesh.creation.icosphere(subdivisions, radius).triangles)


def open_ball():
    """A ball without its lowest cap."""
    triangles = ball()
    return triangles[triangles[:, :, 1].mean(axis=1) > -0.9]


def loose_ball():
    """A ball of triangles that nowhere share a corner."""
    middles = ball().mean(axis=1, keepdims=True)
    return middles + 0.9 * (ball() - middles)


def volume(triangles):
    """Of the solid that triangles bound, or None."""
    surface = from_triangles(triangles)
    try:
        return mesh_solid(surface, surface.center, 1.0).volume()
    except NotClosed:
        return None


@pytest.mark.usefixtures("meshlab")
def test_closing_welds_seams_and_drops_doubled_and_flat_triangles():
    whole = ball()
    shaken = whole + 1e-8 * np.random.default_rng(0).normal(size=whole.shape)
    flat = np.repeat(whole[:5, :1], 3, axis=1)
    cleaned = close_holes(np.concatenate([shaken, whole[:40], flat]))
    assert len(cleaned) == len(whole)
    assert len(np.unique(cleaned.reshape(-1, 3), axis=0)) == len(whole) // 2 + 2


@pytest.mark.usefixtures("meshlab")
def test_a_lid_closes_a_hole():
    assert volume(open_ball()) is None
    np.testing.assert_allclose(volume(close_holes(open_ball())), volume(ball()), rtol=0.05)


@pytest.mark.usefixtures("meshlab")
@pytest.mark.parametrize("offset", [0.0, 1e5])
def test_the_wrap_closes_what_lids_cannot(offset):
    assert volume(loose_ball()) is None
    wrapped = wrap(loose_ball() + offset)
    np.testing.assert_allclose(volume(wrapped), volume(ball()), rtol=0.03)
    np.testing.assert_allclose((wrapped.min(axis=(0, 1)) + wrapped.max(axis=(0, 1))) / 2, offset, atol=0.02)


@pytest.mark.usefixtures("meshlab")
def test_nothing_stays_nothing():
    assert len(close_holes(np.zeros((0, 3, 3)))) == 0
    assert len(wrap(np.zeros((2, 3, 3)))) == 0


@pytest.mark.parametrize(
    ("error", "remedy"),
    [
        (ModuleNotFoundError("No module named 'pymeshlab'"), r"pip install 'sdfprim\[repair\]'"),
        (ImportError("libGL.so.1: no such file"), r"libGL\.so\.1.*apt-get install libgl1 libopengl0"),
    ],
    ids=["the module", "a library of the system"],
)
def test_what_is_missing_is_named_with_what_installs_it(without_meshlab, error, remedy):
    without_meshlab(error)
    with pytest.raises(NoMeshLab, match=remedy):
        mending.wrap(ball())


# ------------------------------------------------------------------------------ bodies that have holes


@pytest.mark.usefixtures("meshlab")
@pytest.mark.parametrize("body", [open_ball, loose_ball], ids=["a hole, for a lid", "cracks, to be wrapped"])
def test_a_body_that_is_not_quite_closed_is_a_solid_all_the_same(body):
    solid = find_solid(find_air(from_triangles(body()), resolution=60))
    assert solid is not None
    points = np.array([[0.0, 0, 0], [0, 0.9, 0], [0.6, -0.6, 0], [0, 1.1, 0], [0.8, 0.8, 0]])
    assert solid.inside(points).tolist() == [True, True, True, False, False]


@pytest.mark.parametrize(("body", "missed"), [(open_ball, True), (ball, False)])
def test_without_meshlab_a_body_with_holes_stays_open_and_says_so(without_meshlab, body, missed):
    without_meshlab(ModuleNotFoundError("No module named 'pymeshlab'"))
    air = find_air(from_triangles(body()), resolution=60)
    assert (find_solid(air) is None) == missed
    assert ("sdfprim[repair]" in missing_repair(air)) == missed


def test_a_fit_notes_that_a_body_was_not_closed(without_meshlab):
    without_meshlab(ModuleNotFoundError("No module named 'pymeshlab'"))
    corners = open_ball().reshape(-1, 3)
    mesh = Mesh("bowl", corners, corners, np.arange(len(corners), dtype=np.uint32).reshape(-1, 3), 0)
    scene = Scene(
        Path(__file__), meshes=(mesh,), materials=(Material(),), instances=(Instance(0, -1, np.eye(4)),)
    )
    result = fit(scene, FitSettings(max_primitives=1, resolution=48, steps=("bodies",)))
    assert any("sdfprim[repair]" in note for note in result.notes)


@pytest.mark.usefixtures("meshlab")
def test_no_lid_is_put_on_a_bowl():
    bowl = ball()
    bowl = bowl[bowl[:, :, 1].max(axis=1) < 0.1]
    both_sides = np.concatenate([bowl, 0.95 * bowl[:, ::-1]])
    assert find_solid(find_air(from_triangles(both_sides), resolution=60)) is None
