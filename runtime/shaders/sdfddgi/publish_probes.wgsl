// Copies the exact irradiance of every probe into the atlas that lookups filter: half floats relative to the map's
// largest value, with the border that carries bilinear filtering across the octahedral seams.

import package::lib::octahedral::{OCT_SIZE, OCT_TILE, oct_tile_corner, oct_tile_source};
import package::structs::{UpdateSettings};

@group(0) @binding(0) var<uniform> settings: UpdateSettings;
@group(0) @binding(1) var<storage, read> exact_irradiance: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> records: array<vec4f>;
@group(0) @binding(3) var atlas: texture_storage_2d<rgba16float, write>;

const THREADS: u32 = OCT_SIZE * OCT_SIZE;

var<workgroup> map: array<vec3f, THREADS>;

@compute @workgroup_size(8, 8)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let probe = group.x + group.y * groups.x;
    if probe >= settings.probe_count {
        return;
    }
    if records[probe].w < 0.0 {
        return;
    }
    map[thread] = exact_irradiance[probe * THREADS + thread].rgb;
    workgroupBarrier();
    var largest = vec3f(0.0);
    for (var i = 0u; i < THREADS; i++) {
        largest = max(largest, map[i]);
    }
    let scale = max(largest.x, max(largest.y, largest.z));
    let inverse = select(0.0, 1.0 / scale, scale > 0.0);
    let corner = oct_tile_corner(probe, settings.columns);
    for (var i = thread; i < OCT_TILE * OCT_TILE; i += THREADS) {
        let texel = vec2u(i % OCT_TILE, i / OCT_TILE);
        let source = oct_tile_source(texel);
        let value = map[source.x + OCT_SIZE * source.y] * inverse;
        textureStore(atlas, corner + texel, vec4f(value, 1.0));
    }
    if thread == 0u {
        records[probe].w = scale;
    }
}
