"""The primitive set: its rules, its transforms, and the 64 bytes that the GPU holds of each primitive."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fit import encoding, rotation, sdf
from fit.primitives import (
    FACES,
    GPU_RECORD_BYTES,
    Kind,
    PrimitiveSet,
    make_box,
    make_cylinder,
    make_half_space,
    make_plane,
    make_sphere,
    pack_gpu,
    packing_losses,
    shared_face_colors,
    unpack_gpu,
)

seeds = st.integers(0, 2**32 - 1)


def unit_quaternions(seed: int, count: int) -> np.ndarray:
    return rotation.normalized(np.random.default_rng(seed).normal(size=(count, 4)))


def one_of_each(seed: int = 0) -> PrimitiveSet:
    """A box, a sphere, a cylinder, a plane and a half-space, turned and coloured at random."""
    rng = np.random.default_rng(seed)
    turns = unit_quaternions(seed, 4)
    return PrimitiveSet.concatenate(
        [
            make_box(rng.normal(size=3), rng.uniform(0.1, 3, 3), turns[0], rng.random((6, 3)), name="wall"),
            make_sphere(rng.normal(size=3), 0.7, rng.random(3), (5, 4, 3)),
            make_cylinder(rng.normal(size=3), 0.2, 2.0, turns[1], rng.random((6, 3))),
            make_plane(rng.normal(size=3), 2.0, 1.0, 0.04, turns[2], rng.random((6, 3)), name="sheet"),
            make_half_space(rng.normal(size=3), turns[3], rng.random(3)),
        ]
    )


def equal(a: PrimitiveSet, b: PrimitiveSet) -> bool:
    fields = ("kinds", "positions", "rotations", "sizes", "albedo", "emission")
    return a.names == b.names and all(np.array_equal(getattr(a, f), getattr(b, f)) for f in fields)


def changed(field: str, index: tuple, value: float) -> PrimitiveSet:
    primitives = one_of_each()
    array = getattr(primitives, field).copy()
    array[index] = value
    return replace(primitives, **{field: array})


BROKEN = [
    (changed("kinds", (2,), 4), r"primitive 2, kind 4: no such kind"),
    (changed("positions", (0, 1), np.nan), r"primitive 0 \('wall'\), box: position is not finite"),
    (changed("positions", (4, 1), np.inf), r"primitive 4, plane: position"),
    (changed("rotations", (3, 0), 2.0), r"primitive 3 \('sheet'\), plane: rotation .* normalise"),
    (changed("rotations", (1, 0), np.nan), r"primitive 1, sphere: rotation"),
    (changed("sizes", (0, 2), 0.0), r"primitive 0 .*sizes must be finite and above 0"),
    (changed("sizes", (0, 2), -1.0), r"primitive 0 .*sizes must be finite and above 0"),
    (changed("sizes", (2, 1), np.inf), r"primitive 2, cylinder: sizes must be finite"),
    (changed("sizes", (1, 1), 1.5), r"primitive 1, sphere: sizes across must be equal"),
    (changed("sizes", (2, 0), 0.5), r"primitive 2, cylinder: sizes across must be equal"),
    (changed("sizes", (3, 1), 0.06), r"primitive 3 .*thicker than 5% .* make it a box"),
    (changed("sizes", (3, 0), np.inf), r"primitive 3 .*a half-space has the sizes \(inf, 0, inf\)"),
    (changed("sizes", (4, 1), 0.1), r"primitive 4, plane: a half-space has the sizes"),
    (changed("albedo", (0, 0, 0), 1.01), r"primitive 0 .*albedo must be from 0 to 1"),
    (changed("albedo", (0, 0, 0), np.nan), r"primitive 0 .*albedo must be from 0 to 1"),
    (changed("albedo", (1, 3, 0), 0.123), r"primitive 1, sphere: albedo differs .* shared_face_colors"),
    (changed("albedo", (2, 1, 0), 0.123), r"primitive 2, cylinder: albedo differs"),
    (changed("albedo", (3, 5, 0), 0.0), r"primitive 3 .*albedo differs"),
    (changed("emission", (0, 0, 0), -1.0), r"primitive 0 .*emission must be finite and not negative"),
    (changed("emission", (0, 0, 0), np.inf), r"primitive 0 .*emission must be finite"),
    (replace(one_of_each(), names=("a",)), r"1 names for 5 primitives"),
    (
        replace(one_of_each(), sizes=np.ones((5, 2))),
        r"sizes is float64 \(5, 2\); a set of 5 needs float64 \(5, 3\)",
    ),
    (replace(one_of_each(), albedo=np.ones((5, 6, 3))), r"albedo is float64 .* needs float32 \(5, 6, 3\)"),
]


@pytest.mark.parametrize(("broken", "message"), BROKEN, ids=[message[:40] for _, message in BROKEN])
def test_validate_names_the_primitive_and_the_remedy(broken, message):
    with pytest.raises(ValueError, match=message):
        broken.validate()


def test_validate_accepts_sound_sets():
    assert one_of_each().validate() is not None
    assert len(PrimitiveSet.empty().validate()) == 0


def test_concatenate_and_select_are_inverse():
    primitives = one_of_each()
    singles = [primitives.select(i) for i in range(len(primitives))]
    assert [len(s) for s in singles] == [1] * 5
    assert equal(PrimitiveSet.concatenate(singles), primitives)
    assert equal(primitives.select(slice(None)), primitives)
    assert primitives.select([3, 0]).names == ("sheet", "wall")
    assert primitives.select(primitives.kinds == Kind.PLANE).kinds.tolist() == [Kind.PLANE] * 2
    assert len(PrimitiveSet.concatenate([])) == 0
    unnamed = PrimitiveSet.concatenate([make_box(), make_sphere(name="lamp")])
    assert unnamed.names == ("", "lamp")


@given(seed=seeds, scale=st.floats(1e-3, 1e3))
@settings(max_examples=40, deadline=None)
def test_transformed_moves_distances_along(seed, scale):
    rng = np.random.default_rng(seed)
    primitives = one_of_each(seed)
    matrix = np.eye(4)
    matrix[:3, :3] = scale * rotation.matrices_from_quaternions(unit_quaternions(seed + 1, 1)[0])
    matrix[:3, 3] = rng.normal(size=3) * scale * 10
    points = rng.normal(size=(50, 3)) * 3
    moved = points @ matrix[:3, :3].T + matrix[:3, 3]
    expected = sdf.distance(primitives, points) * scale
    found = sdf.distance(primitives.transformed(matrix).validate(), moved)
    np.testing.assert_allclose(found, expected, atol=1e-12 * scale * 50)


def test_transformed_keeps_what_the_identity_keeps():
    primitives = one_of_each()
    assert equal(primitives.transformed(np.eye(4)), primitives)


@pytest.mark.parametrize(
    "linear",
    [np.diag([1.0, 2, 1]), np.diag([-1.0, 1, 1]), np.diag([1.0, 1, 0]), np.eye(3) + 0.1 * np.eye(3, k=1)],
    ids=["uneven", "mirror", "flat", "shear"],
)
def test_transformed_refuses_what_is_no_similarity(linear):
    matrix = np.eye(4)
    matrix[:3, :3] = linear
    with pytest.raises(ValueError, match="the matrix"):
        one_of_each().transformed(matrix)
    with pytest.raises(ValueError, match=r"\(4, 4\)"):
        one_of_each().transformed(np.eye(3))


@given(seed=seeds)
@settings(max_examples=20, deadline=None)
def test_boxes_are_tight(seed):
    primitives = one_of_each(seed).select(slice(0, 4))
    lower, upper = primitives.boxes()
    points, _, index = sdf.sample_boundary(primitives, 40_000, seed)
    for i in range(4):
        own = points[index == i]
        size = np.linalg.norm(primitives.sizes[i])
        assert np.all(own.min(axis=0) >= lower[i] - 1e-12) and np.all(own.max(axis=0) <= upper[i] + 1e-12)
        assert np.all(own.min(axis=0) - lower[i] < 0.1 * size) and np.all(
            upper[i] - own.max(axis=0) < 0.1 * size
        )
    np.testing.assert_array_equal(primitives.bounds(), (lower.min(axis=0), upper.max(axis=0)))


def test_boxes_are_exact_where_they_are_known():
    quarter = (0, 0, np.sqrt(0.5), np.sqrt(0.5))
    turned = PrimitiveSet.concatenate(
        [make_box(size=(1, 2, 3), rotation=quarter), make_cylinder(radius=1, height=6, rotation=quarter)]
    )
    lower, upper = turned.boxes()
    np.testing.assert_allclose(upper, [[1, 0.5, 1.5], [3, 1, 1]], atol=1e-7)
    np.testing.assert_allclose(lower, -upper)
    tilted = make_cylinder(radius=1, height=2, rotation=(0, 0, np.sin(np.pi / 8), np.cos(np.pi / 8)))
    np.testing.assert_allclose(tilted.boxes()[1][0], [np.sqrt(2), np.sqrt(2), 1])


def test_bounds_leave_half_spaces_out():
    np.testing.assert_array_equal(
        PrimitiveSet.concatenate([make_box(), make_half_space()]).bounds(), [[-0.5] * 3, [0.5] * 3]
    )
    with pytest.raises(ValueError, match="no finite primitive"):
        make_half_space().bounds()


def test_shared_face_colors_weigh_by_area():
    colors = np.zeros((3, 6, 3))
    colors[:, 0], colors[:, 2], colors[:, 3] = 0.8, 0.4, 0.2
    areas = np.array([[3.0, 1, 1, 1, 1, 1]] * 3)
    shared = shared_face_colors([Kind.SPHERE, Kind.CYLINDER, Kind.PLANE], colors, areas)[:, :, 0]
    np.testing.assert_allclose(shared[0], [3 / 8] * 6)
    np.testing.assert_allclose(shared[1], [0.4, 0.4, 0.4, 0.2, 0.4, 0.4])
    np.testing.assert_allclose(shared[2], [0.3, 0.3, 0.4, 0.2, 0.3, 0.3], rtol=1e-6)
    box = np.random.default_rng(0).random((1, 6, 3)).astype(np.float32)
    np.testing.assert_array_equal(shared_face_colors([Kind.BOX], box), box)


def test_with_uniform_color_covers_every_face():
    primitives = one_of_each().with_uniform_color((0.1, 0.2, 0.3), (4, 5, 6))
    np.testing.assert_array_equal(primitives.albedo, np.broadcast_to(np.float32([0.1, 0.2, 0.3]), (5, 6, 3)))
    np.testing.assert_array_equal(primitives.emission, np.broadcast_to(np.float32([4, 5, 6]), (5, 6, 3)))


@given(seed=seeds)
@settings(max_examples=30, deadline=None)
def test_quaternions_and_matrices_are_inverse(seed):
    q = unit_quaternions(seed, 20)
    matrices = rotation.matrices_from_quaternions(q)
    np.testing.assert_allclose(np.linalg.det(matrices), 1)
    back = rotation.quaternions_from_matrices(matrices)
    np.testing.assert_allclose(back * np.sign(np.sum(back * q, axis=1))[:, None], q, atol=1e-14)
    product = rotation.matrices_from_quaternions(rotation.multiply(q[:10], q[10:]))
    np.testing.assert_allclose(product, matrices[:10] @ matrices[10:], atol=1e-14)


# The GPU record.


@given(seed=seeds)
@settings(max_examples=40, deadline=None)
def test_packing_keeps_everything_to_its_precision(seed):
    rng = np.random.default_rng(seed)
    origin = rng.normal(size=3) * 1e4
    primitives = one_of_each(seed)
    primitives = replace(primitives, positions=primitives.positions + origin)
    words = pack_gpu(primitives, origin)
    assert words.shape == (5, 16) and words.dtype == np.uint32 and words[0].nbytes == GPU_RECORD_BYTES == 64
    back = unpack_gpu(words, origin).validate()
    np.testing.assert_array_equal(back.kinds, primitives.kinds)
    np.testing.assert_array_equal(back.is_half_space, [False] * 4 + [True])
    np.testing.assert_allclose(back.positions - origin, primitives.positions - origin, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(back.sizes, primitives.sizes, rtol=1e-7)
    assert np.abs(back.albedo - primitives.albedo).max() < 0.002
    np.testing.assert_allclose(back.emission, primitives.emission, rtol=0.003)


@given(seed=seeds)
@settings(max_examples=40, deadline=None)
def test_packed_rotations_are_near(seed):
    q = unit_quaternions(seed, 200)
    back, _ = encoding.decode_rotation(encoding.encode_rotation(q, np.zeros(200, np.uint8)))
    error = np.minimum(np.linalg.norm(back - q, axis=1), np.linalg.norm(back + q, axis=1))
    assert error.max() < 3e-6
    np.testing.assert_allclose(np.linalg.norm(back, axis=1), 1, atol=1e-15)


@pytest.mark.parametrize("axis", range(4))
@pytest.mark.parametrize("sign", [1, -1])
def test_packed_half_turns_are_exact(axis, sign):
    q = np.zeros((1, 4))
    q[0, axis] = sign
    back, kinds = encoding.decode_rotation(encoding.encode_rotation(q, np.array([3], np.uint8)))
    np.testing.assert_array_equal(back, np.abs(q))
    assert kinds[0] == 3


def test_packed_quarter_turns_are_exact_to_float64():
    q = np.array([[0, np.sqrt(0.5), 0, np.sqrt(0.5)], [np.sqrt(0.5), 0, -np.sqrt(0.5), 0]])
    back, _ = encoding.decode_rotation(encoding.encode_rotation(q, np.zeros(2, np.uint8)))
    np.testing.assert_allclose(back, q, atol=3e-16)


def test_record_layout_bit_by_bit():
    """The bits that docs/formats.md promises to the shaders, from literal numbers."""
    albedo = np.zeros((6, 3), np.float32)
    albedo[0] = (1.0, 0.0, 0.25)
    emission = np.zeros((6, 3), np.float32)
    emission[1], emission[4] = (1.0, 0.5, 0.0), (2.0, 2.0, 2.0)
    turn = rotation.normalized([0.1, -0.2, 0.3, 0.9])
    box = make_box((11, 20, 30), (2, 4, 6), turn, albedo, emission)
    words = pack_gpu(box, (10, 20, 30))[0]
    assert words[0:3].view(np.float32).tolist() == [1, 0, 0]
    assert words[3:6].view(np.float32).tolist() == [1, 2, 3]
    a, b, c = (round(v * np.sqrt(2) * 524287) + 524288 for v in box.rotations[0, :3])
    assert int(words[6]) | int(words[7]) << 32 == Kind.BOX | 3 << 2 | a << 4 | b << 24 | c << 44
    root = round(0.5 * 1023)
    assert words[8] == 1023 | root << 20
    assert words[9] == 1 << 30 and words[12] == 2 << 30
    assert words[10] == words[11] == words[13] == 0
    assert words[14] == 256 | 128 << 9 | 16 << 27
    assert words[15] == 256 | 256 << 9 | 256 << 18 | 17 << 27
    half_space = pack_gpu(make_half_space())[0]
    assert half_space[3:6].view(np.float32).tolist() == [-1, 0, -1]
    assert half_space[6] & 15 == Kind.PLANE | 3 << 2


def test_selector_three_shows_both_emissions():
    words = pack_gpu(make_box(emission=(1, 0, 0)))
    words[0, 15] = encoding.encode_rgb9e5([0.0, 2.0, 0.0])
    words[0, 8] |= np.uint32(3 << 30)
    np.testing.assert_array_equal(unpack_gpu(words).emission[0, 0], [1, 2, 0])
    np.testing.assert_array_equal(unpack_gpu(words).emission[0, 1], [1, 0, 0])


def test_a_two_sided_lamp_keeps_both_sides_exactly():
    emission = np.zeros((6, 3))
    emission[2], emission[3] = (8, 0, 0), (0, 0, 2)
    lamp = make_plane(size_x=2, size_z=1, thickness=0.05, emission=emission)
    assert packing_losses(lamp).reduced_emissions == 0
    np.testing.assert_array_equal(unpack_gpu(pack_gpu(lamp)).emission, lamp.emission)
    words = pack_gpu(lamp)[0]
    per_face = encoding.decode_rgb9e5(words[14:16])
    shown = np.stack([words[8:14] >> 30 & 1, words[8:14] >> 31], axis=1) @ per_face
    np.testing.assert_allclose(lamp.face_areas()[0] @ shown, lamp.face_areas()[0] @ lamp.emission[0])


@given(seed=seeds)
@settings(max_examples=40, deadline=None)
def test_many_emissions_keep_their_power(seed):
    rng = np.random.default_rng(seed)
    emission = rng.uniform(0, 20, (6, 3))
    emission[rng.integers(0, 6)] = 0
    box = make_box(size=rng.uniform(0.1, 5, 3), emission=emission)
    assert packing_losses(box).reduced_emissions == 1
    back = unpack_gpu(pack_gpu(box))
    areas = box.face_areas()[0]
    np.testing.assert_allclose(
        areas @ back.emission[0], areas @ box.emission[0], rtol=0.003, atol=0.02 * areas.sum()
    )
    np.testing.assert_array_equal(back.emission[0] == 0, np.broadcast_to((box.emission[0] == 0), (6, 3)))


def test_reduction_joins_what_is_alike():
    emission = np.array([[10.0] * 3, [11] * 3, [1] * 3, [10] * 3, [1.5] * 3, [0] * 3])
    back = unpack_gpu(pack_gpu(make_box(emission=emission))).emission[0, :, 0]
    np.testing.assert_allclose(back, [31 / 3, 31 / 3, 1.25, 31 / 3, 1.25, 0], rtol=0.003)


def test_losses_count_clamped_emissions():
    assert packing_losses(make_sphere(emission=(1e6, 0, 0))).clamped_emissions == 1
    assert packing_losses(one_of_each()).clamped_emissions == 0
    brightest = unpack_gpu(pack_gpu(make_sphere(emission=(1e6, 0, 0)))).emission[0, 0, 0]
    assert brightest == encoding.RGB9E5_LARGEST


@given(st.lists(st.floats(0, 1), min_size=3, max_size=3))
def test_albedo_code_is_within_two_permille(color):
    back = encoding.decode_albedo(encoding.encode_albedo([color]))[0]
    assert np.abs(back - color).max() < 0.002
    ends = encoding.decode_albedo(encoding.encode_albedo([[0.0, 1.0, 0.0]]))[0]
    np.testing.assert_array_equal(ends, [0, 1, 0])


@given(st.floats(3.1e-5, 65408), st.floats(0, 1), st.floats(0, 1))
def test_shared_exponent_code_is_within_two_permille_of_the_largest(top, green, blue):
    color = np.array([top, top * green, top * blue])
    back = encoding.decode_rgb9e5(encoding.encode_rgb9e5(color))
    assert np.abs(back - color).max() <= 0.002 * top
    faint = encoding.decode_rgb9e5(encoding.encode_rgb9e5(color * 1e-9))
    assert np.abs(faint - color * 1e-9).max() <= 3e-8 or top > 1e4


def test_shared_exponent_code_of_exact_values():
    colors = np.array([[0, 0, 0], [1, 0.5, 0.25], [511, 510, 1], [512, 512, 512], [511.9, 0, 0]])
    back = encoding.decode_rgb9e5(encoding.encode_rgb9e5(colors))
    np.testing.assert_array_equal(back[:4], colors[:4])
    np.testing.assert_array_equal(back[4], [512, 0, 0])


def test_faces_are_in_the_order_of_the_names():
    assert FACES == ("+x", "-x", "+y", "-y", "+z", "-z")
    areas = make_box(size=(2, 3, 5)).face_areas()[0]
    np.testing.assert_array_equal(areas, [15, 15, 10, 10, 6, 6])
