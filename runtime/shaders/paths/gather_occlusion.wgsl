// Ambient occlusion at given points by rays: the share of the hemisphere, weighted by the cosine, that nothing within the
// radius covers. What is covered fades out over the last share `falloff` of the radius. Adds to earlier dispatches.

import package::lib::random::{random_cosine_direction, random_hash, random_uniform};
import package::structs::{OcclusionSettings};
import package::tracer::sights::{sight_along, sight_start};

@group(0) @binding(0) var<uniform> settings: OcclusionSettings;

// Position and normal of each point.
@group(0) @binding(1) var<storage, read> points: array<vec4f>;

// Sum of the samples.
@group(0) @binding(2) var<storage, read_write> sums: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let index = id.x + settings.row * id.y;
    if id.x >= settings.row || index >= arrayLength(&sums) {
        return;
    }
    let normal = points[2u * index + 1u].xyz;
    let start = sight_start(points[2u * index].xyz, normal);
    for (var i = 0u; i < settings.samples; i++) {
        let u = random_uniform(random_hash(vec3u(index, settings.first_sample + i, settings.seed)));
        let seen = sight_along(start.xyz, random_cosine_direction(normal, u.xy), settings.radius);
        let covered = clamp((1.0 - seen.t / settings.radius) / settings.falloff, 0.0, 1.0);
        sums[index] += 1.0 - select(0.0, covered, seen.is_hit);
    }
}
