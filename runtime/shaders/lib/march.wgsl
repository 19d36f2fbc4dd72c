// Sphere tracing (Hart 1996) through the world's primitives.
//
// Half-spaces are met by a division. The finite primitives lie inside the grid, so the march runs only where the ray
// crosses it. All primitives are convex: a ray that starts by leaving one never meets it again, so that one is left
// out, and rays that graze the surface they start from take long steps at once.

import package::lib::candidates::{Nearest, nearest_finite_within, nearest_primitive, world_distance};
import package::lib::primitives::{decode_albedo, decode_emission, shape_face, shape_gradient};
import package::lib::stride::{STRIDE_HEAD_ON, STRIDE_PLAIN, stride_first_slope, stride_length, stride_next_slope};
import package::world::bindings::{FAR, NO_PRIMITIVE, primitives, world, world_shape};

// A ray that has not arrived after so many steps creeps along a surface and counts as having met it: a ray that
// were let through instead would leak.
const MARCH_STEPS: u32 = 128u;

// How long the strides are, of lib/stride, and whether a query is told how far its answer can be (SDFDDGI, eq. 4). All
// settings give the same hits; docs/gi.md has what each costs.
override MARCH_STRIDES: u32 = 3u;
override MARCH_BOUND: u32 = 1u;

// Strides of `trace_start`, the least of them as a share of the margin, and the share of its distance that a point
// may lose to a stride: in a corner, the other wall comes no nearer.
const START_STEPS: u32 = 8u;
const START_HAIR: f32 = 0.125;
const START_GAIN: f32 = 0.9;

// Smallest cosine between a surface's normal and the face through which a point of it leaves a primitive.
const START_BACK: f32 = -0.3;

struct Hit {
    t: f32,
    primitive: u32,
    position: vec3f,
    normal: vec3f,
    albedo: vec3f,
    emission: vec3f,
    steps: u32,
    asked: u32,
}

// Where a ray ends, without asking what the surface there is like. steps: queries for the nearest primitive; asked: the
// distances to primitives that these took.
struct Arrival {
    t: f32,
    primitive: u32,
    steps: u32,
    asked: u32,
    // The smallest (distance to a primitive) / (distance along the ray) at the points where the ray passes one by.
    clearance: f32,
}

fn march_half_spaces(origin: vec3f, direction: vec3f, reach: f32) -> Arrival {
    var arrival = Arrival(reach, NO_PRIMITIVE, 0u, 0u, FAR);
    for (var index = world.finite_count; index < world.primitive_count; index++) {
        let shape = world_shape(index);
        let normal = shape_gradient(shape, origin);
        let height = dot(origin - shape.position, normal);
        let descent = -dot(direction, normal);
        if height <= 0.0 {
            if descent > 0.0 || height < -world.hit_distance {
                return Arrival(0.0, index, 0u, 0u, 0.0);
            }
        } else if descent > 0.0 && height < arrival.t * descent {
            arrival = Arrival(height / descent, index, 0u, 0u, FAR);
        }
    }
    return arrival;
}

// The part of a ray, from x to y, that lies in the grid; empty when y < x.
fn march_grid_span(origin: vec3f, direction: vec3f, reach: f32) -> vec2f {
    let tiny = select(vec3f(1e-12), -vec3f(1e-12), direction < vec3f(0.0));
    let inverse = 1.0 / select(direction, tiny, abs(direction) < vec3f(1e-12));
    let a = (world.grid_lower - origin) * inverse;
    let b = (world.grid_upper - origin) * inverse;
    let entry = min(a, b);
    let exit = max(a, b);
    return vec2f(max(max(entry.x, entry.y), max(entry.z, 0.0)), min(min(exit.x, exit.y), min(exit.z, reach)));
}

// Where the ray meets the world first, at most `reach` away; NO_PRIMITIVE where it meets nothing. A ray that starts
// inside a primitive ends there at once.
fn march_ray(origin: vec3f, direction: vec3f, reach: f32) -> Arrival {
    return march_by_strides(MARCH_STRIDES, origin, direction, reach);
}

// A stride beyond the free ball is kept to where the ball at its end meets that at its start: then all of the way is
// free. Else the ray steps back to where a plain stride leads. Whether it has arrived is only asked where it stays, and
// a stride ends at the ray's own end at most.
fn march_by_strides(method: u32, origin: vec3f, direction: vec3f, reach: f32) -> Arrival {
    var arrival = march_half_spaces(origin, direction, reach);
    let span = march_grid_span(origin, direction, arrival.t);
    if world.finite_count == 0u || span.y <= span.x {
        return arrival;
    }
    var t = span.x;
    var radius = 0.0;
    var stride = 0.0;
    var slope = stride_first_slope(method);
    var bound = FAR;
    var left = NO_PRIMITIVE;
    var nearest = Nearest(FAR, NO_PRIMITIVE, 0u);
    var before = FAR;
    var is_approaching = false;
    for (var step = 1u; step <= MARCH_STEPS; step++) {
        let position = origin + direction * (t + stride);
        nearest = nearest_finite_within(position, left, bound);
        arrival.steps = step;
        arrival.asked += nearest.asked;
        if step == 1u && span.x <= 0.0 && march_is_leaving(nearest, position, direction) {
            left = nearest.primitive;
            continue;
        }
        if stride > radius && stride > radius + nearest.distance {
            slope = STRIDE_HEAD_ON;
            stride = radius;
            bound = march_bound(radius, stride);
            continue;
        }
        if stride > 0.0 {
            slope = stride_next_slope(method, slope, (nearest.distance - radius) / stride);
        }
        t += stride;
        let is_bound = nearest.primitive == NO_PRIMITIVE;
        radius = nearest.distance;
        if radius < world.hit_distance && !is_bound {
            if !march_is_leaving(nearest, position, direction) {
                return Arrival(t, nearest.primitive, step, arrival.asked, 0.0);
            }
            radius = world.hit_distance;
            slope = STRIDE_HEAD_ON;
        }
        if nearest.distance > before || is_bound {
            if is_approaching {
                arrival.clearance = min(arrival.clearance, before / t);
            }
            is_approaching = false;
        } else if before < FAR && nearest.distance < before {
            is_approaching = true;
        }
        before = select(nearest.distance, 0.0, is_bound);
        if t + radius >= span.y {
            return arrival;
        }
        stride = min(stride_length(method, radius, slope), span.y - t);
        bound = select(march_bound(radius, stride), FAR, is_bound);
    }
    return Arrival(t, select(nearest.primitive, left, nearest.primitive == NO_PRIMITIVE), MARCH_STEPS, arrival.asked, 0.0);
}

// No distance grows by more than the stride (SDFDDGI, eq. 3 and 4: twice the last one, for a plain stride); the hit
// distance covers rounding.
fn march_bound(distance: f32, stride: f32) -> f32 {
    return select(FAR, distance + stride + world.hit_distance, MARCH_BOUND != 0u);
}

// Whether a ray at a position on a primitive's surface, or outside of it, goes away from it.
fn march_is_leaving(nearest: Nearest, position: vec3f, direction: vec3f) -> bool {
    return nearest.primitive != NO_PRIMITIVE
        && nearest.distance > -world.hit_distance
        && dot(shape_gradient(world_shape(nearest.primitive), position), direction) >= 0.0;
}

// The surface that a ray sees; its primitive is NO_PRIMITIVE, and t the reach, where it sees none.
fn trace(origin: vec3f, direction: vec3f, reach: f32) -> Hit {
    let arrival = march_ray(origin, direction, reach);
    let position = origin + direction * arrival.t;
    if arrival.primitive == NO_PRIMITIVE {
        return Hit(reach, NO_PRIMITIVE, position, -direction, vec3f(0.0), vec3f(0.0), arrival.steps, arrival.asked);
    }
    let shape = world_shape(arrival.primitive);
    let face = shape_face(shape, position);
    let last = primitives[4u * arrival.primitive + 3u];
    let word = select(primitives[4u * arrival.primitive + 2u][face % 4u], last[face % 4u], face >= 4u);
    let albedo = decode_albedo(word);
    let emission = decode_emission(word, last.z, last.w);
    let normal = shape_gradient(shape, position);
    return Hit(arrival.t, arrival.primitive, position, normal, albedo, emission, arrival.steps, arrival.asked);
}

// 1 when nothing lies on the way from `origin` along `direction` as far as `reach`, else 0.
fn trace_visibility(origin: vec3f, direction: vec3f, reach: f32) -> f32 {
    return select(0.0, 1.0, march_ray(origin, direction, reach).primitive == NO_PRIMITIVE);
}

// The same with a penumbra (Aaltonen 2018): a way that passes a primitive by within `softness` radians, seen from the
// origin, lets through less. Only passing by counts, not the surface that the way leaves or the one it ends at, so
// that no surface darkens itself. Strides are plain: longer ones would look at the narrow places too seldom.
fn trace_soft_visibility(origin: vec3f, direction: vec3f, reach: f32, softness: f32) -> f32 {
    let arrival = march_by_strides(STRIDE_PLAIN, origin, direction, reach);
    if arrival.primitive != NO_PRIMITIVE {
        return 0.0;
    }
    return smoothstep(0.0, softness, arrival.clearance);
}

// Where to start looking from a point of a surface that may lie inside a primitive or too near to one; w = 0 when
// `world.start_limit` metres lead to no free place. Along the normal is the first choice; the side of a moulding or a
// reveal, though, looks along the wall that the primitives merge it with, and leaves it through the nearest face.
fn trace_start(position: vec3f, normal: vec3f) -> vec4f {
    let start = march_out_along_normal(position, normal);
    if start.w > 0.0 {
        return start;
    }
    return march_out_through_faces(position, normal);
}

// The same for a point that a viewer sees, `view` pointing at it: the air between both is free, whatever the primitives
// say. Where one of them stands in this air within `world.start_limit` of the start, as the flat stand-in of a
// curtain's folds does, the point belongs to the side of it that the viewer sees.
fn trace_start_seen(position: vec3f, normal: vec3f, view: vec3f) -> vec4f {
    let start = march_out_along_normal(position, normal);
    if start.w > 0.0 && trace_visibility(start.xyz, view, world.start_limit) > 0.0 {
        return start;
    }
    let seen = march_back_from_viewer(start.xyz, normal, view);
    if seen.w > 0.0 {
        return seen;
    }
    if start.w > 0.0 {
        return start;
    }
    return march_out_through_faces(position, normal);
}

// Before the first surface that a viewer meets on the last `world.start_limit` metres to a point; w = 0 where that
// surface looks away from the point's own side, or where there is none.
fn march_back_from_viewer(position: vec3f, normal: vec3f, view: vec3f) -> vec4f {
    let far = position + view * world.start_limit;
    if world_distance(far) <= 0.0 {
        return vec4f(far, 0.0);
    }
    let arrival = march_ray(far, -view, world.start_limit);
    if arrival.primitive == NO_PRIMITIVE {
        return vec4f(position, 0.0);
    }
    let place = far - view * arrival.t;
    let face = shape_gradient(world_shape(arrival.primitive), place);
    let start = march_out_along_normal(place, face);
    return vec4f(start.xyz, select(0.0, start.w, dot(face, normal) > START_BACK));
}

// The point moved along its normal until `world.start_margin` is free around it, or as much as the gap there has.
// Every stride stays inside the solid that holds the point or inside the ball that is free around it, so no wall is
// ever crossed.
fn march_out_along_normal(position: vec3f, normal: vec3f) -> vec4f {
    let hair = START_HAIR * world.start_margin;
    var moved = 0.0;
    var distance = world_distance(position);
    for (var step = 0u; step < START_STEPS; step++) {
        if distance >= world.start_margin || moved > world.start_limit {
            break;
        }
        let stride = select(max(distance, hair), hair - distance, distance < 0.0);
        let onwards = world_distance(position + normal * (moved + stride));
        if distance > 0.0 && onwards < START_GAIN * distance {
            break;
        }
        moved += stride;
        distance = onwards;
    }
    return vec4f(position + normal * moved, select(0.0, 1.0, distance > 0.0 && moved <= world.start_limit));
}

// The point pushed out of one primitive after the other through the face nearest to it, never through one that looks
// away from its own side.
fn march_out_through_faces(position: vec3f, normal: vec3f) -> vec4f {
    let hair = START_HAIR * world.start_margin;
    var place = position;
    for (var step = 0u; step < START_STEPS; step++) {
        let nearest = nearest_primitive(place);
        if nearest.distance > 0.0 {
            return vec4f(place, 1.0);
        }
        let outward = shape_gradient(world_shape(nearest.primitive), place);
        place += outward * (hair - nearest.distance);
        if dot(outward, normal) < START_BACK || distance(place, position) > world.start_limit {
            break;
        }
    }
    return vec4f(place, 0.0);
}
