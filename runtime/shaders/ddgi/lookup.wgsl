// Irradiance from the probes around a point (Majercik et al. 2019, section 4.2): trilinear weights times a wrapped
// cosine, so that probes behind the surface fade out, times the chance by Chebyshev's inequality that the probe sees the
// point. Weights are never quite zero, so there is always an answer; where no probe sees the point, it is a leak.

import package::ddgi::cascades::{cascade_cell, cascade_corner, cascade_probe, cascade_share, ddgi};
import package::ddgi::states::{PROBE_ON};
import package::lib::octahedral::{oct_tile_corner, oct_tile_position};
import package::probes::cells::{cell_weight};
import package::probes::maps::{DISTANCE_SIZE, IRRADIANCE_SIZE};

// Position of each probe, and its state in w.
@group(2) @binding(1) var<storage, read> probe_states: array<vec4f>;
@group(2) @binding(2) var irradiance_atlas: texture_2d<f32>;
@group(2) @binding(3) var distance_atlas: texture_2d<f32>;
@group(2) @binding(4) var probe_sampler: sampler;

const GI_PI: f32 = 3.14159265358979;

// What a probe behind the surface still counts, below which weights are crushed, and the least of them.
const WRAP_FLOOR: f32 = 0.2;
const CRUSH_BELOW: f32 = 0.2;
const SMALLEST_WEIGHT: f32 = 1e-6;
const SMALLEST_TRILINEAR: f32 = 1e-3;

// What the map of irradiance holds for a normal: E to the power 1 / gamma.
fn ddgi_encoded_irradiance(index: u32, normal: vec3f) -> vec3f {
    let corner = oct_tile_corner(index, ddgi.columns, IRRADIANCE_SIZE);
    let uv = oct_tile_position(corner, normal, IRRADIANCE_SIZE) / vec2f(textureDimensions(irradiance_atlas));
    return textureSampleLevel(irradiance_atlas, probe_sampler, uv, 0.0).rgb;
}

// Chance that nothing lies between a probe and a point at `way` from it, by the mean and the mean square of the
// distances that the probe saw around this direction.
fn ddgi_chebyshev(index: u32, way: vec3f, spacing: f32) -> f32 {
    let reach = length(way);
    let corner = oct_tile_corner(index, ddgi.columns, DISTANCE_SIZE);
    let uv = oct_tile_position(corner, way / max(reach, 1e-20), DISTANCE_SIZE) / vec2f(textureDimensions(distance_atlas));
    // In units of the farthest distance that counts, so that half floats serve any scene.
    let moments = textureSampleLevel(distance_atlas, probe_sampler, uv, 0.0).rg;
    let beyond = reach / (ddgi.farthest * spacing) - moments.x;
    if beyond <= 0.0 {
        return 1.0;
    }
    let variance = abs(moments.x * moments.x - moments.y);
    let chance = variance / max(variance + beyond * beyond, 1e-20);
    return chance * chance * chance;
}

// The answer of one cascade; w = 0 where none of its probes has one.
fn ddgi_cascade_irradiance(number: u32, position: vec3f, normal: vec3f, view: vec3f) -> vec4f {
    let cascade = ddgi.cascades[number];
    let biased = position + (normal * ddgi.normal_bias + view * ddgi.view_bias) * cascade.spacing;
    let cell = cascade_cell(cascade, biased);
    var total = vec4f(0.0);
    for (var corner = 0u; corner < 8u; corner++) {
        let index = cascade_probe(cascade, cascade_corner(cascade, cell, corner));
        let probe = probe_states[index];
        if probe.w < PROBE_ON {
            continue;
        }
        let wrapped = (dot(normalize(probe.xyz - position), normal) + 1.0) * 0.5;
        var weight = wrapped * wrapped + WRAP_FLOOR;
        if cascade.visibility > 0.0 {
            weight *= mix(1.0, ddgi_chebyshev(index, biased - probe.xyz, cascade.spacing), cascade.visibility);
        }
        weight = max(weight, SMALLEST_WEIGHT);
        if weight < CRUSH_BELOW {
            weight *= weight * weight / (CRUSH_BELOW * CRUSH_BELOW);
        }
        weight *= max(cell_weight(cell, corner), SMALLEST_TRILINEAR);
        // Blended as square roots: between a bright and a dark probe the eye sees a straight line.
        let root = pow(ddgi_encoded_irradiance(index, normal), vec3f(0.5 * ddgi.gamma));
        total += weight * vec4f(root, 1.0);
    }
    let root = total.rgb / max(total.w, 1e-30);
    return select(vec4f(0.0), vec4f(root * root, 1.0), total.w > 0.0);
}

// From the finest cascade that holds the point; towards its border, and where it has no probe, from the next ones.
fn gi_irradiance(position: vec3f, normal: vec3f, view: vec3f) -> vec3f {
    var total = vec4f(0.0);
    for (var number = 0u; number < ddgi.cascade_count && total.w < 1.0; number++) {
        let share = (1.0 - total.w) * cascade_share(number, position);
        if share > 0.0 {
            total += share * ddgi_cascade_irradiance(number, position, normal, view);
        }
    }
    return total.rgb / max(total.w, 1e-30);
}

// Radiance from the half of the sphere around a direction, weighted by the cosine to it.
fn gi_radiance(position: vec3f, direction: vec3f) -> vec3f {
    return gi_irradiance(position, direction, direction) / GI_PI;
}
