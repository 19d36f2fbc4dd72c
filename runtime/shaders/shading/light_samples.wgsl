// Irradiance at the chosen pixels, for a technique whose lookup shares nothing between pixels: one whole lookup each.

import package::lib::frame::{frame, frame_towards_viewer};
import package::shading::pixels::{NO_PIXEL, pixel_surface, pixel_unpack};
import package::technique::lookup::{gi_irradiance};

@group(0) @binding(9) var sample_pixels: texture_2d<u32>;
@group(0) @binding(11) var sample_light: texture_storage_2d<rgba32float, write>;

// No visibility is traced, so nothing says how far a sample holds but the likeness of the surfaces.
const ANY_DISTANCE: f32 = 3.0e38;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= textureDimensions(sample_pixels)) {
        return;
    }
    let packed = textureLoad(sample_pixels, id.xy, 0).x;
    var light = vec4f(0.0, 0.0, 0.0, -1.0);
    if packed != NO_PIXEL {
        let surface = pixel_surface(pixel_unpack(packed));
        let view = frame_towards_viewer(surface.position);
        light = vec4f(gi_irradiance(surface.position, surface.normal, view), ANY_DISTANCE);
    }
    textureStore(sample_light, id.xy, light);
}
