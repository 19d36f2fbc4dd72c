// Counter-based random numbers (the PCG hashes of Jarzynski and Olano 2020) and low-discrepancy directions.

const PI: f32 = 3.14159265358979;

fn random_hash(key: vec3u) -> vec3u {
    var v = key * 1664525u + 1013904223u;
    v.x += v.y * v.z;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    v ^= v >> vec3u(16u);
    v.x += v.y * v.z;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    return v;
}

// Uniform in [0, 1): the 24 highest bits, which float32 holds exactly.
fn random_uniform(bits: vec3u) -> vec3f {
    return vec3f(bits >> vec3u(8u)) * (1.0 / 16777216.0);
}

// Element `index` of a sequence of three words that fills space evenly (the R3 sequence of Roberts 2018), begun at random
// for each key: the mean over some elements in a row has less noise than over as many random numbers.
fn random_sequence(key: vec3u, index: u32) -> vec3u {
    return random_hash(key) + index * vec3u(3518319155u, 2882110345u, 2360945575u);
}

// A uniformly distributed rotation from three uniform numbers (Shoemake 1992).
fn random_rotation(u: vec3f) -> vec4f {
    let a = 2.0 * PI * u.y;
    let b = 2.0 * PI * u.z;
    let s = sqrt(1.0 - u.x);
    let t = sqrt(u.x);
    return vec4f(s * sin(a), s * cos(a), t * sin(b), t * cos(b));
}

// Point `index` of `count` on the spherical Fibonacci lattice (Keinert et al. 2015).
fn spherical_fibonacci(index: u32, count: u32) -> vec3f {
    let z = 1.0 - (2.0 * f32(index) + 1.0) / f32(count);
    let angle = 2.0 * PI * fract(f32(index) * 0.61803398874989);
    let r = sqrt(max(1.0 - z * z, 0.0));
    return vec3f(r * cos(angle), r * sin(angle), z);
}

// A direction over a surface, by the cosine to its normal, from two uniform numbers; in an orthonormal basis without
// branches (Duff et al. 2017).
fn random_cosine_direction(normal: vec3f, u: vec2f) -> vec3f {
    let angle = 2.0 * PI * u.x;
    let radius = sqrt(u.y);
    let s = select(-1.0, 1.0, normal.z >= 0.0);
    let a = -1.0 / (s + normal.z);
    let b = normal.x * normal.y * a;
    let tangent = vec3f(1.0 + s * normal.x * normal.x * a, s * b, -s * normal.x);
    let bitangent = vec3f(b, s + normal.y * normal.y * a, -normal.y);
    let height = sqrt(max(1.0 - u.y, 0.0));
    return normalize(tangent * (radius * cos(angle)) + bitangent * (radius * sin(angle)) + normal * height);
}
