// Irradiance from the probes around a point (SDFDDGI, section 3.4): trilinear weights times the visibility that the
// primitives give, renormalised. There is no weight by cosine or by depth statistics: what is seen counts, what is
// hidden does not, so nothing leaks at any spacing. Where no probe is seen, and outside of a grid that follows the viewer,
// the answer is that part of the sky's irradiance which a few rays find free.

import package::lib::march::{trace_soft_visibility, trace_start, trace_start_seen, trace_visibility};
import package::lib::octahedral::{oct_tile_corner, oct_tile_position};
import package::lib::random::{random_cosine_direction};
import package::probes::cells::{ProbeCell, cell_weight};
import package::probes::grid::{probe_cell, probe_corner, probe_count, probe_grid, probe_index, probe_share};
import package::probes::maps::{IRRADIANCE_SIZE};
import package::probes::states::{probe_is_lit};
import package::world::bindings::{FAR};
import package::structs::{ProbeRecord};

@group(2) @binding(1) var<storage, read> probe_records: array<ProbeRecord>;
@group(2) @binding(2) var probe_atlas: texture_2d<f32>;
@group(2) @binding(3) var probe_sampler: sampler;

const GI_PI: f32 = 3.14159265358979;

// A weight this small cannot be told from none.
const GI_SMALLEST_WEIGHT: f32 = 1e-6;

const SKY_RAYS: u32 = 4u;

// What a probe stores for a normal: the linear part of its irradiance, and the rest from its map.
fn probe_irradiance(index: u32, normal: vec3f) -> vec3f {
    let record = probe_records[index];
    let texel = oct_tile_position(oct_tile_corner(index, probe_grid.columns, IRRADIANCE_SIZE), normal, IRRADIANCE_SIZE);
    let uv = texel / vec2f(textureDimensions(probe_atlas));
    let rest = textureSampleLevel(probe_atlas, probe_sampler, uv, 0.0).rgb * record.position.w;
    let h = vec4f(1.0, normal);
    return max(vec3f(dot(record.red, h), dot(record.green, h), dot(record.blue, h)) + rest, vec3f(0.0));
}

// Share of a probe that a point sees; 0 when the probe is off, or holds no light yet.
fn probe_visibility(index: u32, start: vec3f) -> f32 {
    let position = probe_records[index].position;
    if !probe_is_lit(position.w) {
        return 0.0;
    }
    let way = position.xyz - start;
    let reach = length(way);
    return trace_soft_visibility(start, way / max(reach, 1e-20), reach, probe_grid.softness);
}

// Where none of the eight probes is seen, the nearest seen ones of the next ring answer, weighted by the inverse
// square of their distance in spacings; where those are hidden too, the sky does.
fn probe_ring_irradiance(cell: ProbeCell, start: vec3f, normal: vec3f) -> vec4f {
    var total = vec4f(0.0);
    for (var i = 0u; i < 64u; i++) {
        let offset = vec3i(vec3u(i, i >> 2u, i >> 4u) & vec3u(3u)) - 1;
        let place = vec3i(cell.base) + offset;
        let is_inner = all(offset >= vec3i(0)) && all(offset <= vec3i(1));
        if is_inner || any(place < vec3i(0)) || any(place >= vec3i(probe_grid.counts)) {
            continue;
        }
        let index = probe_index(vec3u(place));
        let seen = probe_visibility(index, start);
        if seen > 0.0 {
            let way = (probe_records[index].position.xyz - start) / probe_grid.spacing;
            let weight = seen / max(dot(way, way), 1e-3);
            total += weight * vec4f(probe_irradiance(index, normal), 1.0);
        }
    }
    return total;
}

// Light of the sky that gets past the primitives along one of SKY_RAYS rays, and along all of them. A wall on every side
// leaves nothing.
fn probe_sky_along(ray: u32, start: vec3f, normal: vec3f) -> f32 {
    let u = vec2f(fract(f32(ray) * 0.61803398874989), (f32(ray) + 0.5) / f32(SKY_RAYS));
    return trace_visibility(start, random_cosine_direction(normal, u), FAR);
}

fn probe_sky_irradiance(start: vec3f, normal: vec3f) -> vec3f {
    let whole = probe_irradiance(probe_count(), normal);
    if all(whole == vec3f(0.0)) {
        return whole;
    }
    var free = 0.0;
    for (var ray = 0u; ray < SKY_RAYS; ray++) {
        free += probe_sky_along(ray, start, normal);
    }
    return whole * (free / f32(SKY_RAYS));
}

// Mean of a cell's probes from the sum of the weighted ones (w: of their weights), or of the ring's where it is nothing;
// w = 0 where none of those is seen either.
fn probe_mean(total: vec4f, cell: ProbeCell, start: vec3f, normal: vec3f) -> vec4f {
    var sum = total;
    if sum.w < GI_SMALLEST_WEIGHT {
        sum = probe_ring_irradiance(cell, start, normal);
    }
    return select(vec4f(0.0), vec4f(sum.rgb / sum.w, 1.0), sum.w > 0.0);
}

// The grid's share of the answer, if a probe is seen, and the sky's.
fn probe_or_sky(mean: vec4f, share: f32, start: vec3f, normal: vec3f) -> vec3f {
    let total = share * mean;
    if total.w == 1.0 {
        return total.rgb;
    }
    return total.rgb + (1.0 - total.w) * probe_sky_irradiance(start, normal);
}

// Of the grid's probes; w = 0 where none is seen.
fn probe_grid_irradiance(start: vec3f, normal: vec3f) -> vec4f {
    let cell = probe_cell(start);
    var total = vec4f(0.0);
    for (var corner = 0u; corner < 8u; corner++) {
        let weight = cell_weight(cell, corner);
        if weight < GI_SMALLEST_WEIGHT {
            continue;
        }
        let index = probe_index(probe_corner(cell, corner));
        let seen = weight * probe_visibility(index, start);
        if seen > 0.0 {
            total += seen * vec4f(probe_irradiance(index, normal), 1.0);
        }
    }
    return probe_mean(total, cell, start, normal);
}

fn gi_irradiance(position: vec3f, normal: vec3f, view: vec3f) -> vec3f {
    let start = trace_start_seen(position, normal, view);
    if start.w == 0.0 {
        return vec3f(0.0);
    }
    var mean = vec4f(0.0);
    let share = probe_share(start.xyz);
    if share > 0.0 {
        mean = probe_grid_irradiance(start.xyz, normal);
    }
    return probe_or_sky(mean, share, start.xyz, normal);
}

// One of the eight probes, drawn by the same weights: its expected value is gi_irradiance, at about an eighth of the
// cost. A probe that is not seen is struck off and another one drawn. u: uniform in [0, 1).
fn gi_irradiance_of_one(position: vec3f, normal: vec3f, u: f32) -> vec3f {
    let start = trace_start(position, normal);
    if start.w == 0.0 {
        return vec3f(0.0);
    }
    let inside = probe_share(start.xyz);
    if u >= inside {
        let ray = u32(f32(SKY_RAYS) * (u - inside) / (1.0 - inside));
        return probe_irradiance(probe_count(), normal) * probe_sky_along(min(ray, SKY_RAYS - 1u), start.xyz, normal);
    }
    let cell = probe_cell(start.xyz);
    var struck = 0u;
    var share = u / inside;
    for (var draw = 0u; draw < 8u; draw++) {
        var left = 0.0;
        for (var corner = 0u; corner < 8u; corner++) {
            left += select(cell_weight(cell, corner), 0.0, ((struck >> corner) & 1u) != 0u);
        }
        if left < GI_SMALLEST_WEIGHT {
            break;
        }
        var rest = share * left;
        var drawn = 0u;
        for (var corner = 0u; corner < 8u; corner++) {
            let weight = select(cell_weight(cell, corner), 0.0, ((struck >> corner) & 1u) != 0u);
            if weight > 0.0 {
                drawn = corner;
                if rest < weight {
                    share = rest / weight;
                    break;
                }
                rest -= weight;
            }
        }
        let index = probe_index(probe_corner(cell, drawn));
        if probe_visibility(index, start.xyz) > 0.0 {
            return probe_irradiance(index, normal);
        }
        struck |= 1u << drawn;
    }
    let ring = probe_ring_irradiance(cell, start.xyz, normal);
    if ring.w > 0.0 {
        return ring.rgb / ring.w;
    }
    return probe_sky_irradiance(start.xyz, normal);
}

// Radiance from the half of the sphere around a direction, weighted by the cosine to it: E / pi of a surface that
// faces it. For fog and rough reflections.
fn gi_radiance(position: vec3f, direction: vec3f) -> vec3f {
    return gi_irradiance(position, direction, direction) / GI_PI;
}
