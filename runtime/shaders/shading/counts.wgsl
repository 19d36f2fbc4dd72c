// What the fast form of shading has cost, for tests and reports: written only by kernels that are told to count.

import package::structs::{ShadingCounts};

@group(0) @binding(12) var<storage, read_write> counts: ShadingCounts;
