// Pixels that nothing proves to be joined to a sample, at corners, edges and thin things. Short traces to the samples
// around, nearest blocks first, find those that the pixel sees; where there is none it has a whole lookup of its own.

import package::lib::frame::{frame, frame_towards_viewer};
import package::lib::march::{trace_start_seen, trace_visibility};
import package::sdfddgi::lookup::{gi_irradiance};
import package::shading::counts::{counts};
import package::shading::history::{blend_history, no_neighbours, sample_weight, with_sample};
import package::shading::pixels::{NO_PIXEL, pixel_surface, pixel_unpack, surfaces_agree};

// How many there are, then which.
@group(0) @binding(9) var<storage, read> missing: array<u32>;
@group(0) @binding(10) var sample_starts: texture_2d<f32>;
@group(0) @binding(11) var sample_light: texture_2d<f32>;
@group(0) @binding(14) var sample_pixels: texture_2d<u32>;
@group(0) @binding(15) var pixel_irradiance: texture_storage_2d<rgba32float, write>;

// 1: traces are counted.
override IS_COUNTED: u32 = 0u;

const THREADS: u32 = 64u;
const BLOCK: u32 = 4u;

// So many samples are enough.
const ENOUGH: u32 = 3u;

// The nine blocks around a pixel by their distance, four bits each: 0 to 8 row by row.
const NEAREST_FIRST: array<u32, 9> = array<u32, 9>(4u, 1u, 3u, 5u, 7u, 0u, 2u, 6u, 8u);

fn pixel_light(pixel: vec2u) -> vec4f {
    let surface = pixel_surface(pixel);
    let view = frame_towards_viewer(surface.position);
    let start = trace_start_seen(surface.position, surface.normal, view);
    var found = no_neighbours();
    var joined = 0u;
    var tests = 0u;
    var order = NEAREST_FIRST;
    for (var i = 0u; i < 9u && joined < ENOUGH && start.w > 0.0; i++) {
        let block = vec2i(pixel / BLOCK) + vec2i(vec2u(order[i] % 3u, order[i] / 3u)) - 1;
        if any(block < vec2i(0)) || any(block >= vec2i(textureDimensions(sample_pixels))) {
            continue;
        }
        let packed = textureLoad(sample_pixels, block, 0).x;
        let light = textureLoad(sample_light, block, 0);
        if packed == NO_PIXEL || light.w < 0.0 {
            continue;
        }
        let other = pixel_surface(pixel_unpack(packed));
        if !surfaces_agree(surface, other) {
            continue;
        }
        let way = textureLoad(sample_starts, block, 0).xyz - start.xyz;
        let reach = length(way);
        tests++;
        if trace_visibility(start.xyz, way / max(reach, 1e-20), reach) > 0.0 {
            let offset = vec2f(pixel_unpack(packed)) - vec2f(pixel);
            found = with_sample(found, light.rgb, sample_weight(offset, dot(surface.normal, other.normal)));
            joined++;
        }
    }
    if IS_COUNTED != 0u {
        atomicAdd(&counts.join_tests, tests);
        atomicAdd(&counts.lookups, select(0u, 1u, joined == 0u));
    }
    if joined > 0u {
        return blend_history(pixel, surface.normal, found);
    }
    return vec4f(gi_irradiance(surface.position, surface.normal, view), 1.0);
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    for (var i = id.x; i < missing[0]; i += THREADS * groups.x) {
        let pixel = pixel_unpack(missing[1u + i]);
        textureStore(pixel_irradiance, pixel, pixel_light(pixel));
    }
}
