// Sums over a workgroup in a tree of fixed shape: the same bytes every time, and an error that grows with the
// logarithm (source: solver.md §1.4). The kernel declares `const LANES`, its workgroup size, a power of two.

// Eight values a lane; the eighth is a maximum, the others are sums.
struct Eight {
    a: vec4f,
    b: vec4f,
}

var<workgroup> tree_eight: array<Eight, LANES>;

// Must be reached by all lanes; the result is for lane 0.
fn reduce_eight(lane: u32, value: Eight) -> Eight {
    tree_eight[lane] = value;
    for (var stride = LANES / 2u; stride > 0u; stride >>= 1u) {
        workgroupBarrier();
        if lane < stride {
            let x = tree_eight[lane];
            let y = tree_eight[lane + stride];
            tree_eight[lane] = add_eight(x, y);
        }
    }
    workgroupBarrier();
    return tree_eight[0];
}

// The same over each `width` neighbouring lanes, a power of two that is the same for all; for the first lane of each.
fn reduce_eight_within(lane: u32, value: Eight, width: u32) -> Eight {
    tree_eight[lane] = value;
    for (var stride = width / 2u; stride > 0u; stride >>= 1u) {
        workgroupBarrier();
        if lane % width < stride {
            let x = tree_eight[lane];
            let y = tree_eight[lane + stride];
            tree_eight[lane] = add_eight(x, y);
        }
    }
    workgroupBarrier();
    return tree_eight[lane - lane % width];
}

fn add_eight(x: Eight, y: Eight) -> Eight {
    return Eight(x.a + y.a, vec4f(x.b.xyz + y.b.xyz, max(x.b.w, y.b.w)));
}
