"""Colours that stay apart, lamps that are never lost: a room of coloured sheets, the slabs behind them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from fit.air import find_air
from fit.color import color
from fit.glow import find_glow
from fit.lamps import emissive_parts, uncover
from fit.objective import Targets, error
from fit.paint import paint
from fit.palette import Palette, color_cost, find_palette
from fit.primitives import Kind, PrimitiveSet
from fit.scene import Image, Instance, Material, Mesh, Scene, Texture, TextureUse
from fit.shapes import Shapes, join, make_shapes, no_shapes, to_primitives
from fit.spaces import Air
from fit.split import split
from fit.surface import from_scene
from fit.targets import Seen, make_targets, see_surface

WHITE, RED, GREEN = (0.7, 0.7, 0.7), (0.6, 0.05, 0.05), (0.1, 0.5, 0.1)
LEAST = 2e-3


class Room:
    """Quads seen from inside, 4 x 3 x 4 m about the floor; each a mesh with a material of its own."""

    def __init__(self) -> None:
        self.meshes: list[Mesh] = []
        self.materials: list[Material] = []
        self.images: list[Image] = []
        for corner, u, v in (
            ((-2, 0, 2), (4, 0, 0), (0, 0, -4)),
            ((-2, 3, -2), (4, 0, 0), (0, 0, 4)),
            ((-2, 0, 2), (0, 0, -4), (0, 3, 0)),
            ((2, 0, -2), (0, 0, 4), (0, 3, 0)),
            ((2, 0, 2), (-4, 0, 0), (0, 3, 0)),
        ):
            self.quad(corner, u, v, WHITE)

    def quad(self, corner, u, v, albedo=(0, 0, 0), emission=(0, 0, 0), pixels=None) -> None:
        corner, u, v = (np.array(a, float) for a in (corner, u, v))
        positions = np.array([corner, corner + u, corner + u + v, corner + v])
        self.mesh(positions, [[0, 1, 2], [0, 2, 3]], albedo, emission, pixels)

    def mesh(self, positions, triangles, albedo, emission, pixels=None) -> None:
        texture = None
        if pixels is not None:
            texture = TextureUse(len(self.images))
            self.images.append(Image("image", pixels))
        base = (*albedo, 1.0) if pixels is None else (1.0, 1.0, 1.0, 1.0)
        self.materials.append(Material(base_color=base, base_color_texture=texture, emission=emission))
        positions = np.asarray(positions, float)
        uv = (
            np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
            if len(positions) == 4
            else np.zeros((len(positions), 2))
        )
        rows = np.asarray(triangles, np.uint32)
        number = len(self.meshes)
        self.meshes.append(Mesh(f"part {number}", positions, np.zeros_like(positions), rows, number, (uv,)))

    def look(self) -> Look:
        count = len(self.meshes)
        scene = Scene(
            Path("built.gltf"),
            meshes=tuple(self.meshes),
            materials=tuple(self.materials),
            textures=tuple(Texture(i, linear=False) for i in range(len(self.images))),
            images=tuple(self.images),
            instances=tuple(Instance(i, -1, np.eye(4)) for i in range(count)),
        )
        surface = from_scene(scene)
        air = find_air(surface, scene, resolution=40, seeds=[(1, 2.2, 1)])
        seen = see_surface(air, 4000, 0)
        targets = make_targets(seen, air, seen.weights, 2000, 0)
        return Look(scene, air, seen, targets, find_palette(scene, air, seen, error(no_shapes(), targets)))


@dataclass(frozen=True)
class Look:
    scene: Scene
    air: Air
    seen: Seen
    targets: Targets
    palette: Palette

    def painted(self, shapes: Shapes, limit: int = 20, kept: int = 0) -> Shapes:
        return paint(shapes, self.targets, self.palette, limit=limit, least_gain=LEAST, kept=kept)

    def cost(self, shapes: Shapes) -> float:
        return color_cost(to_primitives(shapes), self.palette)

    def colored(self, shapes: Shapes) -> PrimitiveSet:
        glow = find_glow(self.scene, self.air)
        return color(to_primitives(shapes), self.scene, self.air, self.seen, glow)


def slabs() -> Shapes:
    """Six boxes of 0.3 m behind the sheets; the last one is the north wall, at z = -2."""
    boxes = []
    for axis, half, middle in ((1, 1.5, 1.5), (0, 2, 0), (2, 2, 0)):
        for side in (1, -1):
            center, halves = np.array([0, 1.5, 0.0]), np.array([2.3, 1.8, 2.3])
            center[axis], halves[axis] = middle + side * (half + 0.15), 0.15
            boxes.append(make_shapes(Kind.BOX, center[None], np.eye(3), halves))
    return join(boxes)


def north(room: Room, x0: float, x1: float, y0: float, y1: float, albedo, **options) -> None:
    room.quad((x0, y0, -2), (x1 - x0, 0, 0), (0, y1 - y0, 0), albedo, **options)


def faces_toward_south(primitives: PrimitiveSet) -> list[tuple[float, ...]]:
    """Albedo of the face that looks along +z, of every primitive at the north wall."""
    at_wall = np.flatnonzero(np.abs(primitives.positions[:, 2] + 2) < 0.2)
    turns = primitives.rotation_matrices()
    found = []
    for i in at_wall:
        axis = int(np.abs(turns[i][2]).argmax())
        found.append(tuple(primitives.albedo[i, 2 * axis + (turns[i][2, axis] < 0)].round(2).tolist()))
    return found


def test_a_wall_of_two_colours_becomes_two() -> None:
    room = Room()
    north(room, -2, 0.5, 0, 3, RED)
    north(room, 0.5, 2, 0, 3, GREEN)
    look, before = room.look(), slabs()
    assert look.cost(before) > 10 * LEAST
    after = look.painted(before)
    assert len(after) == 7
    assert look.cost(after) < 0.25 * look.cost(before)
    assert error(after, look.targets) == pytest.approx(error(before, look.targets), abs=1e-6), (
        "a cut is exact"
    )
    assert len(look.painted(after)) == 7
    found = faces_toward_south(look.colored(after))
    assert sorted(found) == [pytest.approx(GREEN, abs=0.05), pytest.approx(RED, abs=0.05)]


def test_a_door_of_another_colour_becomes_a_plate() -> None:
    room = Room()
    north(room, -2, -0.7, 0, 3, WHITE)
    north(room, 0.5, 2, 0, 3, WHITE)
    north(room, -0.7, 0.5, 2, 3, WHITE)
    north(room, -0.7, 0.5, 0, 2, RED)
    look = room.look()
    after = look.painted(slabs())
    assert len(after) == 7
    plate = to_primitives(after).select([6])
    assert sorted(plate.sizes[0])[1:] == pytest.approx([1.2, 2.15], abs=0.3)
    painted = look.colored(after)
    assert painted.albedo[6].max(axis=0) == pytest.approx(RED, abs=0.08)
    assert painted.albedo[5].min() > 0.6, "nothing of the door is left in the wall"
    assert error(after, look.targets) < error(slabs(), look.targets) + 1e-3


def test_a_texture_is_one_colour() -> None:
    tiles = np.where((np.indices((64, 64)).sum(0) % 2)[..., None], 230, 40) * np.ones(4)
    room = Room()
    north(room, -2, 2, 0, 3, WHITE, pixels=tiles.astype(np.uint8))
    look = room.look()
    assert len(look.painted(slabs())) == 6


def test_at_the_limit_only_what_is_worth_less_makes_room() -> None:
    room = Room()
    north(room, -2, 0.5, 0, 3, RED)
    north(room, 0.5, 2, 0, 3, GREEN)
    look = room.look()
    idle = make_shapes(Kind.BOX, np.array([[0, -0.2, 0.0]]), np.eye(3), np.full(3, 0.05))
    assert len(look.painted(slabs(), limit=6)) == 6
    kept = look.painted(join([slabs(), idle]), limit=7)
    assert len(kept) == 7
    assert look.cost(kept) < 0.25 * look.cost(slabs())
    assert not np.any((kept.halves == 0.05).all(axis=1))


def test_what_is_kept_is_left_alone() -> None:
    room = Room()
    north(room, -2, 0.5, 0, 3, RED)
    north(room, 0.5, 2, 0, 3, GREEN)
    assert len(room.look().painted(slabs(), kept=6)) == 6


# --------------------------------------------------------------------------------------------------- lamps


def test_a_small_lamp_flush_in_the_ceiling_is_kept_and_emits_downwards_alone() -> None:
    room = Room()
    north(room, -2, 2, 0, 3, WHITE)
    light = (30.0, 20.0, 10.0)
    room.quad((-0.05, 3, -0.03), (0.1, 0, 0), (0, 0, 0.06), emission=light)
    look = room.look()
    parts = split(look.scene, look.air.walls)
    lamps = emissive_parts(find_glow(look.scene, look.air), look.air, parts, 4)
    assert len(lamps) == 1
    lit = look.colored(join([lamps, slabs()]))
    axis = int(np.abs(lit.rotation_matrices()[0][1]).argmax())
    shining = 2 * axis + (lit.rotation_matrices()[0][1, axis] > 0)
    power = lit.emission[0, shining] * lit.face_areas()[0, shining]
    assert power == pytest.approx(np.array(light) * 0.006, rel=0.15)
    assert lit.emission[0, shining ^ 1].max() == 0, "nobody sees its back"
    assert lit.emission[1:].max() == 0, "the ceiling emits nothing"


def ceiling_lamp(*, shade: bool = False) -> tuple[Look, Shapes]:
    room = Room()
    north(room, -2, 2, 0, 3, WHITE)
    if shade:
        room.quad((-0.4, 2.9, -0.3), (0.8, 0, 0), (0, 0, 0.6), WHITE)
    room.quad((-0.4, 3, -0.3), (0.8, 0, 0), (0, 0, 0.6), emission=(30.0, 20.0, 10.0))
    look = room.look()
    parts = split(look.scene, look.air.walls)
    return look, emissive_parts(find_glow(look.scene, look.air), look.air, parts, 4)


def below_the_lamp(shapes: Shapes) -> float:
    """How far under the ceiling the lamp ends."""
    lamp = to_primitives(shapes.select(slice(0, 1)))
    return 3.0 - float(lamp.bounds()[0][1])


def test_a_lamp_grows_out_of_the_slab_that_covers_it() -> None:
    """The ceiling was fitted 3 cm too low."""
    look, lamp = ceiling_lamp()
    room = slabs()
    low = replace(room, centers=room.centers - np.array([[0, 0.03, 0]] + [[0, 0, 0]] * 5))
    covered = join([lamp, low])
    assert below_the_lamp(covered) < 0.03
    mended = uncover(covered, 1, find_glow(look.scene, look.air), look.air)
    assert 0.03 < below_the_lamp(mended) < 0.04
    glow = find_glow(look.scene, look.air)
    lit = color(to_primitives(mended), look.scene, look.air, look.seen, glow, lamps=lamp)
    power = (lit.emission[0] * lit.face_areas()[0][:, None]).sum(axis=0)
    assert power == pytest.approx(np.array([30.0, 20.0, 10.0]) * 0.48, rel=0.15)
    assert lit.emission[1:].max() == 0, "the slab takes none of the lamp's light"


def test_a_lamp_stays_as_it_is_behind_a_bar_a_deep_cover_and_a_shade_of_the_scene() -> None:
    look, lamp = ceiling_lamp()
    bar = make_shapes(Kind.BOX, np.array([[0, 2.98, 0.0]]), np.eye(3), np.array([0.02, 0.05, 0.4]))
    deep = make_shapes(Kind.BOX, np.array([[0, 2.7, 0.0]]), np.eye(3), np.array([1.0, 0.5, 1.0]))
    shade = make_shapes(Kind.BOX, np.array([[0, 2.9, 0.0]]), np.eye(3), np.array([0.4, 0.01, 0.3]))
    shaded, _ = ceiling_lamp(shade=True)
    for seen, cover in ((look, bar), (look, deep), (shaded, shade)):
        shapes, glow = join([lamp, slabs(), cover]), find_glow(seen.scene, seen.air)
        assert len(glow) > 100, "its light is seen, past the edges of a shade as well"
        kept = uncover(shapes, 1, glow, seen.air)
        assert below_the_lamp(kept) == below_the_lamp(shapes)
    open_shade = uncover(join([lamp, slabs(), shade]), 1, find_glow(look.scene, look.air), look.air)
    assert below_the_lamp(open_shade) > 0.11, "nothing in the scene stands there"


def test_a_bulb_in_a_box_gives_as_much_light_as_the_bulb() -> None:
    """Its box has nearly twice its area: as bright, it would give twice the light."""
    room = Room()
    north(room, -2, 2, 0, 3, WHITE)
    bulb = trimesh.creation.icosphere(2, 0.25)
    room.mesh(bulb.vertices + np.array([0, 1.5, 0]), bulb.faces, (0, 0, 0), (8.0, 8.0, 8.0))
    look = room.look()
    box = make_shapes(Kind.BOX, np.array([[0, 1.5, 0.0]]), np.eye(3), np.full(3, 0.25))
    lit = look.colored(join([box, slabs()]))
    power = float((lit.emission[0, :, 0] * lit.face_areas()[0]).sum())
    assert power == pytest.approx(8.0 * bulb.area, rel=0.05)
    assert lit.emission[0].max() < 8.0
    assert lit.emission[1:].max() == 0
    small = make_shapes(Kind.SPHERE, np.array([[0, 1.5, 0.0]]), np.eye(3), np.full(3, 0.1))
    inner = look.colored(join([small, slabs()]))
    assert inner.emission[0].max() == pytest.approx(8.0, rel=1e-5), "never brighter than the lamp"


def test_a_wall_that_glows_in_one_place_is_cut_there() -> None:
    """A screen that is part of a larger textured mesh."""
    room = Room()
    north(room, -2, 1, 0, 3, WHITE)
    north(room, 1, 2, 0, 3, (0, 0, 0), emission=(5.0, 5.0, 5.0))
    look = room.look()
    after = look.painted(slabs())
    lit = look.colored(after)
    glowing = np.flatnonzero(lit.emission.max(axis=(1, 2)) > 0.5)
    assert len(after) == 7
    assert len(glowing) == 1
    assert lit.positions[glowing[0], 0] > 1
    assert lit.emission[glowing[0]].max() == pytest.approx(5, rel=0.1)
