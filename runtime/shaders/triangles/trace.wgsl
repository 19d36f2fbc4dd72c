// First hits of rays on the scene's triangles (Moeller and Trumbore 1997), down a tree of boxes, nearer ones first.

import package::triangles::bindings::{triangle_faces, triangle_nodes};
import package::triangles::surface::{surface_is_open};

const NO_TRIANGLE: u32 = 0xffffffffu;
const STACK: u32 = 32u;

struct TriangleHit {
    t: f32,
    triangle: u32,
    // Shares along the two edges.
    place: vec2f,
    // Of the flat face, not of unit length, as the corners turn.
    face: vec3f,
}

// Distance at which a ray enters a node's box, at least 0; beyond `reach` when it misses.
fn triangles_entry(node: u32, origin: vec3f, inverse: vec3f, reach: f32) -> f32 {
    let a = (triangle_nodes[2u * node].xyz - origin) * inverse;
    let b = (triangle_nodes[2u * node + 1u].xyz - origin) * inverse;
    let near = min(a, b);
    let far = max(a, b);
    let entry = max(max(near.x, near.y), max(near.z, 0.0));
    // Two roundings more than the exact interval: a ray through the seam of two boxes meets at least one.
    let exit = min(min(far.x, far.y), far.z) * 1.0000004;
    return select(3.0e38, entry, entry <= exit && entry < reach);
}

fn triangles_leaf(begin: u32, end: u32, origin: vec3f, direction: vec3f, best: TriangleHit) -> TriangleHit {
    var hit = best;
    for (var triangle = begin; triangle < end; triangle++) {
        let first = triangle_faces[3u * triangle + 1u].xyz;
        let second = triangle_faces[3u * triangle + 2u].xyz;
        let across = cross(direction, second);
        let determinant = dot(first, across);
        if determinant == 0.0 {
            continue;
        }
        let offset = origin - triangle_faces[3u * triangle].xyz;
        let u = dot(offset, across) / determinant;
        let upward = cross(offset, first);
        let v = dot(direction, upward) / determinant;
        let t = dot(second, upward) / determinant;
        if u < 0.0 || v < 0.0 || u + v > 1.0 || t <= 0.0 || t >= hit.t || surface_is_open(triangle, vec2f(u, v)) {
            continue;
        }
        hit = TriangleHit(t, triangle, vec2f(u, v), cross(first, second));
    }
    return hit;
}

// The nearest hit, or with `any_hit` the first one that is found, less than `reach` away.
fn triangles_trace(origin: vec3f, direction: vec3f, reach: f32, any_hit: bool) -> TriangleHit {
    let tiny = select(vec3f(1e-20), vec3f(-1e-20), direction < vec3f(0.0));
    let inverse = 1.0 / select(direction, tiny, abs(direction) < vec3f(1e-20));
    var hit = TriangleHit(reach, NO_TRIANGLE, vec2f(0.0), vec3f(0.0));
    var nodes: array<u32, STACK>;
    var entries: array<f32, STACK>;
    var depth = 0u;
    nodes[0] = 0u;
    entries[0] = triangles_entry(0u, origin, inverse, reach);
    depth = 1u;
    while depth > 0u {
        depth--;
        let node = nodes[depth];
        if entries[depth] >= hit.t {
            continue;
        }
        let first = bitcast<u32>(triangle_nodes[2u * node].w);
        let count = bitcast<u32>(triangle_nodes[2u * node + 1u].w);
        if count > 0u {
            hit = triangles_leaf(first, first + count, origin, direction, hit);
            if any_hit && hit.triangle != NO_TRIANGLE {
                return hit;
            }
            continue;
        }
        let left_entry = triangles_entry(first, origin, inverse, hit.t);
        let right_entry = triangles_entry(first + 1u, origin, inverse, hit.t);
        let left_is_near = left_entry <= right_entry;
        let far = select(first, first + 1u, left_is_near);
        let near = select(first + 1u, first, left_is_near);
        let far_entry = max(left_entry, right_entry);
        if far_entry < hit.t {
            nodes[depth] = far;
            entries[depth] = far_entry;
            depth++;
        }
        if min(left_entry, right_entry) < hit.t {
            nodes[depth] = near;
            entries[depth] = min(left_entry, right_entry);
            depth++;
        }
    }
    return hit;
}

fn triangles_visible(origin: vec3f, direction: vec3f, reach: f32) -> bool {
    return triangles_trace(origin, direction, reach, true).triangle == NO_TRIANGLE;
}
