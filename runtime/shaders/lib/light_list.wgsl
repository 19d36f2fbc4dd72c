// The lights of the frame, without their shadows.

import package::structs::{Light, Lighting};

@group(3) @binding(3) var<uniform> lighting: Lighting;
@group(3) @binding(4) var<storage, read> lights: array<Light>;
