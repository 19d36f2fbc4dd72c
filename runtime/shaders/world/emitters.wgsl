// Points on the primitives that shine.

import package::lib::emitters::{EmitterPoint, emitter_drawn};
import package::lib::primitives::{CYLINDER, SPHERE, Shape};
import package::lib::quaternion::{quat_rotate};
import package::lib::random::{PI};
import package::world::bindings::{world, world_shape};

struct FacePoint {
    position: vec3f,
    normal: vec3f,
}

fn face_point_on_sphere(radius: f32, u: vec2f) -> FacePoint {
    let z = 1.0 - 2.0 * u.x;
    let across = sqrt(max(1.0 - z * z, 0.0));
    let normal = vec3f(across * cos(2.0 * PI * u.y), across * sin(2.0 * PI * u.y), z);
    return FacePoint(radius * normal, normal);
}

fn face_point_on_cylinder(face: u32, half: vec3f, u: vec2f) -> FacePoint {
    let around = vec3f(cos(2.0 * PI * u.y), 0.0, sin(2.0 * PI * u.y));
    if face == 0u {
        return FacePoint(half.x * around + vec3f(0.0, (2.0 * u.x - 1.0) * half.y, 0.0), around);
    }
    let normal = vec3f(0.0, select(1.0, -1.0, face == 3u), 0.0);
    return FacePoint(half.x * sqrt(u.x) * around + half.y * normal, normal);
}

fn face_point_on_box(face: u32, half: vec3f, u: vec2f) -> FacePoint {
    let axis = face / 2u;
    let side = select(1.0, -1.0, (face & 1u) != 0u);
    var share = vec3f(2.0 * u - 1.0, 0.0);
    if axis == 0u {
        share = share.zxy;
    } else if axis == 1u {
        share = share.xzy;
    }
    var normal = vec3f(0.0);
    normal[axis] = side;
    return FacePoint(half * (share + normal), normal);
}

fn face_point(shape: Shape, face: u32, u: vec2f) -> FacePoint {
    if shape.kind == SPHERE {
        return face_point_on_sphere(shape.half.x, u);
    }
    if shape.kind == CYLINDER {
        return face_point_on_cylinder(face, shape.half, u);
    }
    return face_point_on_box(face, shape.half, u);
}

fn emitter_count() -> u32 {
    return world.emitter_count;
}

// Primitives are convex: from outside, a point that faces the origin is the first of its primitive on the way.
fn emitter_point(origin: vec3f, u: vec3f) -> EmitterPoint {
    let emitter = emitter_drawn(u.x, world.emitter_count);
    let shape = world_shape(emitter.surface);
    let found = face_point(shape, emitter.face, u.yz);
    let position = shape.position + quat_rotate(shape.rotation, found.position);
    let normal = quat_rotate(shape.rotation, found.normal);
    return EmitterPoint(position, normal, emitter.surface, dot(normal, origin - position) > 0.0);
}
