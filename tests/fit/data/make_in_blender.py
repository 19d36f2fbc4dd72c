"""Makes the .glb files beside it: `pip install bpy==5.0.1`, then `python make_in_blender.py SET.glb`.

SET.glb is `every_kind()` of test_export_gltf_reader.py, written by `fit.export`. The files are what an artist
gets who imports the set and exports it again, untouched, with the scale applied, and edited.
"""

import sys
from pathlib import Path

import bpy


def load(source: str) -> None:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=source)


def save(name: str, extras: bool = False) -> None:
    target = Path(__file__).with_name(name)
    bpy.ops.export_scene.gltf(filepath=str(target), export_extras=extras)


def apply_scale() -> None:
    bpy.ops.object.select_all(action="SELECT")
    bpy.context.view_layer.objects.active = next(o for o in bpy.data.objects if o.type == "MESH")
    bpy.ops.object.make_single_user(object=True, obdata=True)
    bpy.ops.object.transform_apply(location=False, rotation=False, scale=True)


def edit() -> None:
    crate = bpy.data.objects["crate mesh"]
    crate.location.z += 1
    crate.scale *= 2
    red = crate.data.materials[0].copy()
    red.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (1, 0, 0, 1)
    crate.data.materials[0] = red
    bpy.data.objects["lamp"].location.x += 5


if __name__ == "__main__":
    source = sys.argv[1]
    load(source)
    save("shapes_dropped.glb")
    load(source)
    apply_scale()
    save("scale_applied.glb")
    load(source)
    edit()
    save("edited.glb", extras=True)
