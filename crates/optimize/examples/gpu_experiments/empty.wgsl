@group(0) @binding(0) var<storage, read_write> data: array<u32>;

@compute @workgroup_size(64)
fn empty(@builtin(global_invocation_id) id: vec3u) {
    if data[0] == 1u {
        return;
    }
    data[id.x] += 1u;
}
