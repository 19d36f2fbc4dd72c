// What the G-buffer held a frame ago. Depth 0 is the background, and everything before the first frame.

import package::lib::normal::{normal_unpack};

@group(0) @binding(5) var previous_depth: texture_depth_2d;
@group(0) @binding(6) var previous_normals: texture_2d<u32>;

fn previous_normal(pixel: vec2u) -> vec3f {
    return normal_unpack(textureLoad(previous_normals, pixel, 0).x);
}
