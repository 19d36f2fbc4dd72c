// The G-buffer as later passes read it. Depth 0 is the background.

import package::lib::normal::{normal_unpack};

@group(0) @binding(0) var gbuffer_depth: texture_depth_2d;
@group(0) @binding(1) var gbuffer_normals: texture_2d<u32>;
@group(0) @binding(2) var gbuffer_albedo: texture_2d<f32>;
@group(0) @binding(3) var gbuffer_emission: texture_2d<f32>;
@group(0) @binding(4) var gbuffer_motion: texture_2d<f32>;

fn gbuffer_normal(pixel: vec2u) -> vec3f {
    return normal_unpack(textureLoad(gbuffer_normals, pixel, 0).x);
}

fn gbuffer_face_normal(pixel: vec2u) -> vec3f {
    return normal_unpack(textureLoad(gbuffer_normals, pixel, 0).y);
}
