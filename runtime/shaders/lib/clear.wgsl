// How far a point of a surface may move along it and surely meet nothing.

import package::lib::candidates::{candidates, candidates_cell, candidates_free, candidates_span};
import package::lib::primitives::{shape_distance, shape_gradient};
import package::world::bindings::{FAR, world, world_shape};

// Metres, in any direction of the plane across `normal`, from a free point. All primitives are convex: a plane across its
// gradient parts each from the point, at its distance, so that the point reaches it after distance / sine of the angle
// between gradient and normal at the earliest. The floor that it stands on is never reached.
fn clear_radius(position: vec3f, normal: vec3f) -> f32 {
    let cell = candidates_cell(position);
    let span = candidates_span(cell, position);
    let half_spaces = world.primitive_count - world.finite_count;
    var radius = FAR;
    var nearest = FAR;
    for (var i = 0u; i < span.count + half_spaces; i++) {
        var index = world.finite_count + i - span.count;
        if i < span.count {
            index = span.first + i;
            if span.is_list {
                index = candidates[index];
            }
        }
        let shape = world_shape(index);
        let away = shape_distance(shape, position);
        let cosine = dot(shape_gradient(shape, position), normal);
        radius = min(radius, away * inverseSqrt(max(1.0 - cosine * cosine, 1e-12)));
        nearest = select(nearest, min(nearest, away), i < span.count);
    }
    if span.is_list {
        radius = min(radius, nearest + candidates_free(cell, position));
    }
    return max(radius, 0.0);
}
