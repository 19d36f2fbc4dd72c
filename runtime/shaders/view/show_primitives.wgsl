// The primitive set alone.

import package::lib::frame::{frame};
import package::view::set_picture::{set_picture};
import package::world::bindings::{FAR};

@group(0) @binding(0) var layer: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= frame.size) {
        return;
    }
    let shown = set_picture(id.xy);
    textureStore(layer, id.xy, vec4f(shown.color, select(1.0, 0.0, shown.t >= FAR)));
}
