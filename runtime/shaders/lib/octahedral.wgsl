// Octahedral maps of the sphere (Cigolle et al. 2014): the square [-1, 1]^2, z > 0 in the inner diamond.
// A stored map is a tile of size^2 texels, size being even, and a border of one texel, so that bilinear filtering is
// right across the seams.

fn oct_encode(direction: vec3f) -> vec2f {
    let p = direction.xy / (abs(direction.x) + abs(direction.y) + abs(direction.z));
    let folded = (vec2f(1.0) - abs(p.yx)) * select(vec2f(-1.0), vec2f(1.0), p >= vec2f(0.0));
    return select(folded, p, direction.z >= 0.0);
}

fn oct_decode(square: vec2f) -> vec3f {
    let z = 1.0 - abs(square.x) - abs(square.y);
    let folded = (vec2f(1.0) - abs(square.yx)) * select(vec2f(-1.0), vec2f(1.0), square >= vec2f(0.0));
    return normalize(vec3f(select(folded, square, z >= 0.0), z));
}

// Direction of the centre of a texel of the map, 0 <= texel < size.
fn oct_texel_direction(texel: vec2u, size: u32) -> vec3f {
    return oct_decode((vec2f(texel) + 0.5) * (2.0 / f32(size)) - 1.0);
}

// The texel of the map that a texel of the tile, 0 <= texel < size + 2, shows: its own, or over the border the
// one across the seam, where the map continues mirrored.
fn oct_tile_source(texel: vec2u, size: u32) -> vec2u {
    let last = i32(size) - 1;
    var p = vec2i(texel) - 1;
    if p.x < 0 || p.x > last {
        p = vec2i(clamp(p.x, 0, last), last - p.y);
    }
    if p.y < 0 || p.y > last {
        p = vec2i(last - p.x, clamp(p.y, 0, last));
    }
    return vec2u(p);
}

// Where in an atlas of `columns` tiles a row tile `index` begins, in texels.
fn oct_tile_corner(index: u32, columns: u32, size: u32) -> vec2u {
    return (size + 2u) * vec2u(index % columns, index / columns);
}

// Position in texels, for filtering, of a direction inside the tile that begins at `corner`.
fn oct_tile_position(corner: vec2u, direction: vec3f, size: u32) -> vec2f {
    return vec2f(corner) + 1.0 + (oct_encode(direction) * 0.5 + 0.5) * f32(size);
}
