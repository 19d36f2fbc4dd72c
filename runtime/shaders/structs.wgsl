// Generated from runtime/layouts.py by `python -m runtime.structs`: edit the classes instead.

struct Frame {  // 320 bytes
    clip_from_local: mat4x4f,           // 0
    previous_clip_from_local: mat4x4f,  // 64
    local_from_view: mat4x4f,           // 128
    camera: vec3f,                      // 192
    frame_index: u32,                   // 204
    extent: vec2f,                      // 208
    depth_map: vec2f,                   // 216
    size: vec2u,                        // 224
    orthographic: u32,                  // 232
    near: f32,                          // 236
    previous_local_from_view: mat4x4f,  // 240
    previous_extent: vec2f,             // 304
    previous_depth_map: vec2f,          // 312
}

struct SkyModel {  // 48 bytes
    base: vec3f,       // 0
    has_picture: u32,  // 12
    slope: vec3f,      // 16
    axis: vec3f,       // 32
}

struct Light {  // 224 bytes
    clip_from_local: mat4x4f,   // 0
    local_from_light: mat4x4f,  // 64
    color: vec3f,               // 128
    kind: u32,                  // 140
    position: vec3f,            // 144
    range: f32,                 // 156
    axis: vec3f,                // 160
    has_tile: u32,              // 172
    tile_corner: vec2f,         // 176
    extent: vec2f,              // 184
    depth_map: vec2f,           // 192
    tile_size: f32,             // 200
    texel_size: f32,            // 204
    angle_scale: f32,           // 208
    angle_offset: f32,          // 212
}

struct Lighting {  // 24 bytes
    atlas_size: vec2f,          // 0
    count: u32,                 // 8
    rsm_tolerance: f32,         // 12
    rsm_normal_agreement: f32,  // 16
}

struct Instance {  // 128 bytes
    local_from_mesh: mat4x4f,           // 0
    previous_local_from_mesh: mat4x4f,  // 64
}

struct SurfaceMaterial {  // 48 bytes
    base_color: vec4f,  // 0
    emission: vec3f,    // 16
    alpha_cutoff: f32,  // 28
    roughness: f32,     // 32
    metallic: f32,      // 36
}

struct ShadingInfo {  // 36 bytes
    share_distance: f32,    // 0
    normal_agreement: f32,  // 4
    slope: f32,             // 8
    slack: f32,             // 12
    filter_width: f32,      // 16
    normal_exponent: f32,   // 20
    history_weight: f32,    // 24
    guess_weight: f32,      // 28
    clip_margin: f32,       // 32
}

struct ShadingCounts {  // 20 bytes
    samples: atomic<u32>,           // 0
    visibility_tests: atomic<u32>,  // 4
    join_tests: atomic<u32>,        // 8
    rings: atomic<u32>,             // 12
    lookups: atomic<u32>,           // 16
}

struct Display {  // 8 bytes
    exposure: f32,    // 0
    tone_curve: u32,  // 4
}

struct WorldInfo {  // 80 bytes
    grid_lower: vec3f,     // 0
    grid_cell: f32,        // 12
    grid_upper: vec3f,     // 16
    culling: u32,          // 28
    grid_size: vec3u,      // 32
    primitive_count: u32,  // 44
    finite_count: u32,     // 48
    cluster_count: u32,    // 52
    hit_distance: f32,     // 56
    start_margin: f32,     // 60
    start_limit: f32,      // 64
    emitter_count: u32,    // 68
    emitter_power: f32,    // 72
}

struct ListUse {  // 16 bytes
    entries: atomic<u32>,        // 0
    longest: atomic<u32>,        // 4
    overflowing: atomic<u32>,    // 8
    block_entries: atomic<u32>,  // 12
}

struct Cluster {  // 32 bytes
    ball: vec4f,  // 0
    first: u32,   // 16
    count: u32,   // 20
}

struct Emitter {  // 12 bytes
    share: f32,    // 0
    surface: u32,  // 4
    face: u32,     // 8
}

struct GatherInfo {  // 4 bytes
    count: u32,  // 0
}

struct TracedRay {  // 32 bytes
    origin: vec3f,     // 0
    reach: f32,        // 12
    direction: vec3f,  // 16
    softness: f32,     // 28
}

struct RayHit {  // 80 bytes
    position: vec3f,  // 0
    t: f32,           // 12
    normal: vec3f,    // 16
    primitive: u32,   // 28
    albedo: vec3f,    // 32
    steps: u32,       // 44
    emission: vec3f,  // 48
    visibility: f32,  // 60
    asked: u32,       // 64
}

struct ProbeGridInfo {  // 64 bytes
    lower: vec3f,   // 0
    spacing: f32,   // 12
    counts: vec3u,  // 16
    columns: u32,   // 28
    turn: vec3u,    // 32
    follows: u32,   // 44
    softness: f32,  // 48
}

struct ProbeRecord {  // 64 bytes
    position: vec4f,  // 0
    red: vec4f,       // 16
    green: vec4f,     // 32
    blue: vec4f,      // 48
}

struct PlaceSettings {  // 80 bytes
    start: vec3f,             // 0
    world_has_changed: u32,   // 12
    steps: vec3i,             // 16
    kept_lower: vec3u,        // 32
    kept_upper: vec3u,        // 48
    clearance: f32,           // 60
    reach: f32,               // 64
    smallest_clearance: f32,  // 68
    jump: f32,                // 72
    attraction: f32,          // 76
}

struct ChoiceSettings {  // 144 bytes
    planes: array<vec4f, 5>,   // 0
    viewer: vec3f,             // 80
    half_distance: f32,        // 92
    forward: vec3f,            // 96
    behind: f32,               // 108
    budget: u32,               // 112
    frame: u32,                // 116
    seed: u32,                 // 120
    longest_wait_seen: f32,    // 124
    longest_wait_unseen: f32,  // 128
    margin: f32,               // 132
}

struct ChoiceTotals {  // 16 bytes
    seen: atomic<u32>,    // 0
    unseen: atomic<u32>,  // 4
    fresh: atomic<u32>,   // 8
    weight: atomic<u32>,  // 12
}

struct ChoiceCounts {  // 16 bytes
    seen: u32,    // 0
    unseen: u32,  // 4
    fresh: u32,   // 8
    weight: u32,  // 12
}

struct UpdateSettings {  // 52 bytes
    batches: u32,           // 0
    fresh_factor: u32,      // 4
    budget: u32,            // 8
    frame: u32,             // 12
    seed: u32,              // 16
    bounce: f32,            // 20
    bounce_stride: u32,     // 24
    reach: f32,             // 28
    since_change: u32,      // 32
    settling_frames: u32,   // 36
    settling_history: f32,  // 40
    settling_growth: f32,   // 44
    history_frames: f32,    // 48
}

struct ProbeHistory {  // 44 bytes
    frames: f32,       // 0
    fluence: f32,      // 4
    drift: f32,        // 8
    spread: f32,       // 12
    age: f32,          // 16
    peak: f32,         // 20
    waited: f32,       // 24
    updates: u32,      // 28
    rsm_asked: u32,    // 32
    rsm_refused: u32,  // 36
    rsm_missed: u32,   // 40
}

struct DdgiCascade {  // 48 bytes
    lower: vec3f,     // 0
    spacing: f32,     // 12
    counts: vec3u,    // 16
    first: u32,       // 28
    turn: vec3u,      // 32
    visibility: f32,  // 44
}

struct DdgiInfo {  // 416 bytes
    cascades: array<DdgiCascade, 8>,  // 0
    cascade_count: u32,               // 384
    columns: u32,                     // 388
    normal_bias: f32,                 // 392
    view_bias: f32,                   // 396
    farthest: f32,                    // 400
    gamma: f32,                       // 404
}

struct RelocateSettings {  // 96 bytes
    inner_lower: vec3f,  // 0
    lean: f32,           // 12
    inner_upper: vec3f,  // 16
    kept_lower: vec3u,   // 32
    cascade: u32,        // 44
    kept_upper: vec3u,   // 48
    probe_count: u32,    // 60
    may_sleep: u32,      // 64
    clearance: f32,      // 68
    reach: f32,          // 72
    reach_of_rays: f32,  // 76
    jump: f32,           // 80
}

struct DdgiUpdate {  // 80 bytes
    rotation: vec4f,         // 0
    first_probe: u32,        // 16
    probe_count: u32,        // 20
    columns: u32,            // 24
    rays: u32,               // 28
    hysteresis: f32,         // 32
    hysteresis_drop: f32,    // 36
    settling_growth: f32,    // 40
    change_clear: f32,       // 44
    change_altogether: f32,  // 48
    gamma: f32,              // 52
    distance_exponent: f32,  // 56
    farthest: f32,           // 60
    reach: f32,              // 64
    bounce: f32,             // 68
}

struct TriangleInfo {  // 12 bytes
    margin: f32,         // 0
    emitter_count: u32,  // 4
    emitter_power: f32,  // 8
}

struct TriangleCorner {  // 24 bytes
    normal: u32,         // 0
    color: u32,          // 4
    base_uv: vec2f,      // 8
    emission_uv: vec2f,  // 16
}

struct TriangleMaterial {  // 48 bytes
    base_color: vec4f,     // 0
    emission: vec3f,       // 16
    alpha_cutoff: f32,     // 28
    base_image: u32,       // 32
    emission_image: u32,   // 36
    is_double_sided: u32,  // 40
}

struct TriangleImage {  // 24 bytes
    first: u32,      // 0
    width: u32,      // 4
    height: u32,     // 8
    wrap_u: u32,     // 12
    wrap_v: u32,     // 16
    is_linear: u32,  // 20
}

struct PathSettings {  // 20 bytes
    count: u32,         // 0
    row: u32,           // 4
    samples: u32,       // 8
    first_sample: u32,  // 12
    seed: u32,          // 16
}

struct OcclusionSettings {  // 24 bytes
    row: u32,           // 0
    samples: u32,       // 4
    first_sample: u32,  // 8
    seed: u32,          // 12
    radius: f32,        // 16
    falloff: f32,       // 20
}

struct ContactInfo {  // 56 bytes
    size: vec2u,          // 0
    scale: u32,           // 8
    frame: u32,           // 12
    seed: u32,            // 16
    slices: u32,          // 20
    steps: u32,           // 24
    step_exponent: f32,   // 28
    radius: f32,          // 32
    falloff: f32,         // 36
    thickness: f32,       // 40
    longest: f32,         // 44
    history_frames: f32,  // 48
    clip_width: f32,      // 52
}
