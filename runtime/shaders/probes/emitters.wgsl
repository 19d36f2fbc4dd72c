// What surfaces that shine send to a probe, by draws of their points, one for each thread of its workgroup.
//
// A probe's rays and these draws are combined by the maximum heuristic (Veach and Guibas 1995): light in one direction
// is counted by one of them alone. Rays are spread evenly, so that they find what fills much of the view with far less
// noise than draws do; draws are for what is small.

import package::lib::random::{PI};
import package::lib::sight::{Sight};
import package::paths::emitters::{emitter_light};
import package::probes::maps::{IRRADIANCE_SIZE};
import package::tracer::emitters::{emitter_count};

const DRAWS: u32 = IRRADIANCE_SIZE * IRRADIANCE_SIZE;

// Light counts by draws where they would be more than so many times as dense as rays if its surface faced the probe: a
// single lamp does whose area fills less than a sixteenth of the view, so that four of 64 rays would meet it. It bounds
// what a draw counts as well.
const DRAWN_ABOVE: f32 = 16.0 / (4.0 * PI);

// Steps of a two-dimensional low-discrepancy sequence (Roberts 2018).
const DRAW_STEPS: vec2f = vec2f(0.7548776662466927, 0.5698402909980532);

var<workgroup> draw_direction: array<vec3f, DRAWS>;
var<workgroup> draw_radiance: array<vec3f, DRAWS>;

struct ProbeEmission {
    // W/m2 at a texel's direction.
    irradiance: vec3f,
    // Mean over the sphere, W/m2/sr.
    radiance: vec3f,
}

// Whether what a ray or a draw sees of an emitter counts by draws. The angle to it has no say: a wall on which the probe
// nearly stands is best found by rays.
fn emission_is_drawn(seen: Sight) -> bool {
    return seen.drawn_share * seen.t * seen.t > DRAWN_ABOVE;
}

// turn: three uniform numbers, other ones for each probe and frame. Every thread of the workgroup must call.
fn probe_emission(position: vec3f, normal: vec3f, thread: u32, farthest: f32, turn: vec3f) -> ProbeEmission {
    var found = ProbeEmission(vec3f(0.0), vec3f(0.0));
    if emitter_count() == 0u {
        return found;
    }
    let u = vec3f((f32(thread) + turn.x) / f32(DRAWS), fract(f32(thread) * DRAW_STEPS + turn.yz));
    let light = emitter_light(position, farthest, u);
    let is_drawn = light.is_met && emission_is_drawn(light.seen);
    draw_direction[thread] = light.direction;
    draw_radiance[thread] = select(vec3f(0.0), light.seen.emission / light.density, is_drawn);
    workgroupBarrier();
    for (var i = 0u; i < DRAWS; i++) {
        found.irradiance += max(dot(normal, draw_direction[i]), 0.0) * draw_radiance[i];
        found.radiance += draw_radiance[i];
    }
    found.irradiance /= f32(DRAWS);
    found.radiance /= 4.0 * PI * f32(DRAWS);
    return found;
}
