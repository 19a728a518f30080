// Writes what `load_unit` of bundle/vectors.wgsl reads; apart from it, because most kernels only read `vectors`.

#import "bundle/vectors.wgsl"

fn store_unit(start: u32, unit: u32, value: Unit) {
    let at = start + UNIT_VEC4 * unit;
    vectors[at] = value.a;
    vectors[at + 1u] = value.b;
#if wide
    vectors[at + 2u] = value.c;
    vectors[at + 3u] = value.d;
#endif
}
