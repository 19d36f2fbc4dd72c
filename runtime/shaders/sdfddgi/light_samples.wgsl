// Irradiance at the chosen pixels, with traces of visibility that neighbours share (SDFDDGI, section 3.4).
//
// In a unit of 2 x 2 samples those share whose starts are near each other and joined by free air: then what one sees,
// in one room, the others could see, and nothing leaks. Of the probes that they ask for together each is tested once,
// from the start of the one that leads. The tests of all units are spread over the threads of the workgroup.

import package::lib::clear::{clear_radius};
import package::lib::frame::{frame, frame_towards_viewer};
import package::lib::march::{trace_start_seen, trace_visibility};
import package::probes::cells::{cell_weight};
import package::probes::grid::{probe_cell, probe_corner, probe_grid, probe_index, probe_share};
import package::sdfddgi::lookup::{
    GI_SMALLEST_WEIGHT, probe_irradiance, probe_mean, probe_or_sky, probe_visibility,
};
import package::shading::counts::{counts};
import package::shading::pixels::{NO_PIXEL, PixelSurface, pixel_surface, pixel_unpack, shading};

@group(0) @binding(9) var sample_pixels: texture_2d<u32>;
@group(0) @binding(10) var sample_starts: texture_storage_2d<rgba32float, write>;
@group(0) @binding(11) var sample_light: texture_storage_2d<rgba32float, write>;

// Samples along the side of a unit: 2, or 4 for fewer tests and coarser edges.
override UNIT: u32 = 2u;

// 1: tests are counted.
override IS_COUNTED: u32 = 0u;

const SIDE: u32 = 8u;
const THREADS: u32 = SIDE * SIDE;
const CORNERS: u32 = 8u;
const NONE: u32 = 0xffffffffu;

// Free places to look from; w is how far they may move and meet nothing, negative where there is no sample.
var<workgroup> starts: array<vec4f, THREADS>;
var<workgroup> normals: array<vec3f, THREADS>;
var<workgroup> leaders: array<u32, THREADS>;
// For each sample and each corner of its cell: the probe that it asks for, and how much of it the test has seen.
var<workgroup> asked: array<u32, THREADS * CORNERS>;
var<workgroup> seen: array<f32, THREADS * CORNERS>;
// Places in both of what has to be tested.
var<workgroup> tests: array<u32, THREADS * CORNERS>;
var<workgroup> test_count: atomic<u32>;
var<workgroup> join_count: atomic<u32>;

// Threads in Morton order, so that those of a unit follow each other.
fn thread_place(thread: u32) -> vec2u {
    let x = (thread & 1u) | ((thread >> 1u) & 2u) | ((thread >> 2u) & 4u);
    let y = ((thread >> 1u) & 1u) | ((thread >> 2u) & 2u) | ((thread >> 3u) & 4u);
    return vec2u(x, y);
}

// Whether one sample may use what another one sees: near to it, and nothing between them.
fn is_joined(leader: u32, thread: u32) -> bool {
    let lead = starts[leader];
    let way = starts[thread].xyz - lead.xyz;
    let reach = length(way);
    if lead.w < 0.0 || starts[thread].w < 0.0 || reach > shading.share_distance * probe_grid.spacing {
        return false;
    }
    let rise = abs(dot(way, normals[leader]));
    if reach < lead.w && rise <= shading.slope * reach + shading.slack {
        return true;
    }
    if IS_COUNTED != 0u {
        atomicAdd(&join_count, 1u);
    }
    return trace_visibility(lead.xyz, way / max(reach, 1e-20), reach) > 0.0;
}

// The one test, among those of a unit's samples with the same leader, that answers for a probe: the leader's own, if it
// asks for the probe too.
fn test_of(thread: u32, probe: u32) -> u32 {
    let leader = leaders[thread];
    for (var corner = 0u; corner < CORNERS; corner++) {
        if asked[CORNERS * leader + corner] == probe {
            return CORNERS * leader + corner;
        }
    }
    let first = thread - thread % (UNIT * UNIT);
    for (var place = CORNERS * first; place < CORNERS * (first + UNIT * UNIT); place++) {
        if asked[place] == probe && leaders[place / CORNERS] == leader {
            return place;
        }
    }
    return NONE;
}

@compute @workgroup_size(8, 8)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) thread: u32) {
    let place = SIDE * group.xy + thread_place(thread);
    let is_inside = all(place < textureDimensions(sample_pixels));
    let packed = select(NO_PIXEL, textureLoad(sample_pixels, place, 0).x, is_inside);
    var surface = PixelSurface(vec3f(0.0), vec3f(0.0, 1.0, 0.0));
    var start = vec4f(0.0, 0.0, 0.0, -1.0);
    if packed != NO_PIXEL {
        surface = pixel_surface(pixel_unpack(packed));
        start = trace_start_seen(surface.position, surface.normal, frame_towards_viewer(surface.position));
        start.w = select(-1.0, clear_radius(start.xyz, surface.normal), start.w > 0.0);
    }
    let is_lit = start.w >= 0.0;
    let cell = probe_cell(start.xyz);
    let share = select(0.0, probe_share(start.xyz), is_lit);
    starts[thread] = start;
    normals[thread] = surface.normal;
    leaders[thread] = NONE;
    for (var corner = 0u; corner < CORNERS; corner++) {
        let is_asked = share > 0.0 && cell_weight(cell, corner) >= GI_SMALLEST_WEIGHT;
        asked[CORNERS * thread + corner] = select(NONE, probe_index(probe_corner(cell, corner)), is_asked);
        seen[CORNERS * thread + corner] = 0.0;
    }
    if thread == 0u {
        atomicStore(&test_count, 0u);
        atomicStore(&join_count, 0u);
    }
    workgroupBarrier();

    // Each sample of a unit in turn, another one first in each frame, leads those that have no leader and are joined to it.
    let size = UNIT * UNIT;
    let first = thread - thread % size;
    for (var turn = 0u; turn < size; turn++) {
        let candidate = first + (turn + frame.frame_index) % size;
        if thread == candidate && leaders[thread] == NONE {
            leaders[thread] = thread;
        }
        workgroupBarrier();
        if leaders[thread] == NONE && leaders[candidate] == candidate && is_joined(candidate, thread) {
            leaders[thread] = candidate;
        }
        workgroupBarrier();
    }

    for (var corner = 0u; corner < CORNERS; corner++) {
        let own = CORNERS * thread + corner;
        if asked[own] != NONE && test_of(thread, asked[own]) == own {
            tests[atomicAdd(&test_count, 1u)] = own;
        }
    }
    workgroupBarrier();
    let count = atomicLoad(&test_count);
    for (var i = thread; i < count; i += THREADS) {
        let test = tests[i];
        seen[test] = probe_visibility(asked[test], starts[test / CORNERS].xyz);
    }
    workgroupBarrier();

    var total = vec4f(0.0);
    for (var corner = 0u; corner < CORNERS; corner++) {
        let probe = asked[CORNERS * thread + corner];
        if probe == NONE {
            continue;
        }
        let weight = cell_weight(cell, corner) * seen[test_of(thread, probe)];
        if weight > 0.0 {
            total += weight * vec4f(probe_irradiance(probe, surface.normal), 1.0);
        }
    }
    if is_inside {
        var light = vec4f(0.0, 0.0, 0.0, -1.0);
        if is_lit {
            var mean = vec4f(0.0);
            if share > 0.0 {
                mean = probe_mean(total, cell, start.xyz, surface.normal);
            }
            light = vec4f(probe_or_sky(mean, share, start.xyz, surface.normal), start.w);
        }
        textureStore(sample_starts, place, start);
        textureStore(sample_light, place, light);
    }
    if IS_COUNTED != 0u {
        if is_lit {
            atomicAdd(&counts.samples, 1u);
            if share > 0.0 && total.w < GI_SMALLEST_WEIGHT {
                atomicAdd(&counts.rings, 1u);
            }
        }
        if thread == 0u {
            atomicAdd(&counts.visibility_tests, count);
            atomicAdd(&counts.join_tests, atomicLoad(&join_count));
        }
    }
}
