// Irradiance of every pixel from the samples around it and from the last frame (SDFDDGI, section 3.4).
//
// A sample answers for a pixel on the same smooth surface, as far away as nothing can lie between the two: so a wall,
// however thin, parts its sides exactly. The last frame's light is fetched from where the point then was, if that
// pixel showed the point, and clipped to the range of those samples, so that it follows what changes and brings in
// nothing that they don't have. Both are blended by a running mean in which a pixel's own sample counts far more
// than what its neighbours' suggest. Pixels for which no sample answers are listed for `shading/fill_pixels`.

import package::lib::frame::{frame};
import package::primary::gbuffer::{gbuffer_depth};
import package::shading::history::{Neighbours, blend_history, no_neighbours, sample_weight, with_sample};
import package::shading::pixels::{
    NO_PIXEL, PixelSurface, pixel_pack, pixel_surface, pixel_unpack, surfaces_agree,
};

@group(0) @binding(9) var sample_pixels: texture_2d<u32>;
// Irradiance; as far as w, in metres, a sample answers for others; negative where there is none.
@group(0) @binding(11) var sample_light: texture_2d<f32>;
@group(0) @binding(14) var pixel_irradiance: texture_storage_2d<rgba32float, write>;
// How many pixels no sample answers for, then which; and the workgroups of 64 that they fill.
@group(0) @binding(15) var<storage, read_write> missing: array<atomic<u32>>;
@group(0) @binding(16) var<storage, read_write> fill_groups: array<atomic<u32>>;

const BLOCK: u32 = 4u;
const SIDE: u32 = 16u;
// Blocks along the side of a workgroup, and one more all around.
const TILE: u32 = SIDE / BLOCK + 2u;

const FILL_THREADS: u32 = 64u;
const MOST_GROUPS: u32 = 65535u;

var<workgroup> tile_light: array<vec4f, TILE * TILE>;
var<workgroup> tile_position: array<vec3f, TILE * TILE>;
var<workgroup> tile_normal: array<vec3f, TILE * TILE>;
var<workgroup> tile_pixel: array<u32, TILE * TILE>;

fn load_tile(corner: vec2i, index: u32) {
    let block = corner + vec2i(vec2u(index % TILE, index / TILE));
    var packed = NO_PIXEL;
    var light = vec4f(0.0, 0.0, 0.0, -1.0);
    var surface = PixelSurface(vec3f(0.0), vec3f(0.0));
    if all(block >= vec2i(0)) && all(block < vec2i(textureDimensions(sample_pixels))) {
        packed = textureLoad(sample_pixels, block, 0).x;
        light = textureLoad(sample_light, block, 0);
    }
    if packed != NO_PIXEL {
        surface = pixel_surface(pixel_unpack(packed));
    } else {
        light.w = -1.0;
    }
    tile_light[index] = light;
    tile_position[index] = surface.position;
    tile_normal[index] = surface.normal;
    tile_pixel[index] = packed;
}

fn neighbours_of(pixel: vec2u, surface: PixelSurface, block: vec2u) -> Neighbours {
    var found = no_neighbours();
    for (var i = 0u; i < 9u; i++) {
        let index = block.x + i % 3u + TILE * (block.y + i / 3u);
        let light = tile_light[index];
        if light.w < 0.0 {
            continue;
        }
        let other = PixelSurface(tile_position[index], tile_normal[index]);
        let offset = vec2f(pixel_unpack(tile_pixel[index])) - vec2f(pixel);
        let is_own = tile_pixel[index] == pixel_pack(pixel);
        let is_near = distance(other.position, surface.position) < light.w;
        if is_own {
            found.own = light.rgb;
            found.has_own = true;
        }
        if is_own || (is_near && surfaces_agree(surface, other)) {
            found = with_sample(found, light.rgb, sample_weight(offset, dot(surface.normal, other.normal)));
        }
    }
    return found;
}

fn list_missing(pixel: vec2u) {
    let index = atomicAdd(&missing[0], 1u);
    atomicStore(&missing[1u + index], pixel_pack(pixel));
    atomicMax(&fill_groups[0], min(index / FILL_THREADS + 1u, MOST_GROUPS));
}

@compute @workgroup_size(16, 16)
fn main(
    @builtin(global_invocation_id) id: vec3u,
    @builtin(workgroup_id) group: vec3u,
    @builtin(local_invocation_id) local: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    if thread < TILE * TILE {
        load_tile(vec2i(group.xy * (SIDE / BLOCK)) - 1, thread);
    }
    workgroupBarrier();
    if any(id.xy >= frame.size) {
        return;
    }
    if textureLoad(gbuffer_depth, id.xy, 0) <= 0.0 {
        textureStore(pixel_irradiance, id.xy, vec4f(0.0));
        return;
    }
    let surface = pixel_surface(id.xy);
    let found = neighbours_of(id.xy, surface, local.xy / BLOCK);
    if found.total.w <= 0.0 {
        list_missing(id.xy);
        return;
    }
    textureStore(pixel_irradiance, id.xy, blend_history(id.xy, surface.normal, found));
}
