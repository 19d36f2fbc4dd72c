// Pixels that no sample answers for, at corners, edges and thin things: a whole lookup each.

import package::lib::frame::{frame, frame_towards_viewer};
import package::shading::pixels::{pixel_surface, pixel_unpack};
import package::technique::lookup::{gi_irradiance};

// How many there are, then which.
@group(0) @binding(9) var<storage, read> missing: array<u32>;
@group(0) @binding(15) var pixel_irradiance: texture_storage_2d<rgba32float, write>;

const THREADS: u32 = 64u;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    for (var i = id.x; i < missing[0]; i += THREADS * groups.x) {
        let pixel = pixel_unpack(missing[1u + i]);
        let surface = pixel_surface(pixel);
        let light = gi_irradiance(surface.position, surface.normal, frame_towards_viewer(surface.position));
        textureStore(pixel_irradiance, pixel, vec4f(light, 1.0));
    }
}
