// The scene's triangles under a tree of boxes, with what their surfaces look like.

import package::structs::{TriangleCorner, TriangleImage, TriangleInfo, TriangleMaterial};

@group(1) @binding(0) var<uniform> triangle_info: TriangleInfo;

// Two words of four a node: the corners of its box, and in w, as unsigned numbers, the first triangle of a leaf or the
// first of two children, and the triangles of a leaf, 0 for other nodes.
@group(1) @binding(1) var<storage, read> triangle_nodes: array<vec4f>;

// Three words of four a triangle: corner with the material's index in w, and the two edges from it.
@group(1) @binding(2) var<storage, read> triangle_faces: array<vec4f>;
@group(1) @binding(3) var<storage, read> triangle_corners: array<TriangleCorner>;
@group(1) @binding(4) var<storage, read> triangle_materials: array<TriangleMaterial>;
@group(1) @binding(5) var<storage, read> triangle_images: array<TriangleImage>;

// sRGB texels of all images, one after the other, rgba in bytes.
@group(1) @binding(6) var<storage, read> triangle_texels: array<u32>;
