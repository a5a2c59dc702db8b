// Maps of a material. Of tiled ones (resources/texture_tiles) the coarse levels are whole, in a texture of the map; finer
// ones are in pages. A word of the page table names the page to look in: its number, the level of its tile, and how far it
// has faded in. All of a tiled map's filtering is done here but for the bilinear filter.

@group(2) @binding(0) var colour_pages: texture_2d_array<f32>; // sRGB
@group(2) @binding(1) var other_pages: texture_2d_array<f32>;
@group(2) @binding(2) var page_sampler: sampler;
@group(2) @binding(3) var page_table: texture_2d<u32>;

const PAGE_TABLE_WIDTH: u32 = 1024u;
const TILE_SIDE: u32 = 256u;
const TILE_BORDER: f32 = 2.0;
const PAGE_SIDE: f32 = 260.0;
const PAGES: u32 = 4u; // along a layer's side

// A coordinate in [0, 1] that shows the same.
fn wrapped(x: f32, mode: u32) -> f32 {
    switch mode {
        case 0u: { return x - floor(x); }
        case 1u: { return clamp(x, 0.0, 1.0); }
        default: { return abs(x - 2.0 * floor(0.5 * x + 0.5)); }
    }
}

// The bilinear texel of a page, `place` texels from its tile's first.
fn page_texel(pages: texture_2d_array<f32>, page: u32, place: vec2<f32>) -> vec4<f32> {
    let corner = vec2<f32>(vec2(page % PAGES, (page / PAGES) % PAGES)) * PAGE_SIDE + TILE_BORDER;
    return textureSampleLevel(pages, page_sampler, (corner + place) / (f32(PAGES) * PAGE_SIDE), page / (PAGES * PAGES), 0.0);
}

// Size of a tiled map's level in texels.
fn tiled_size(slot: u32, level: u32) -> vec2<u32> {
    return max(material.tiled[slot].size >> vec2(material.tiled[slot].levels - 1u - level), vec2(1u));
}

// The texel at a place of a tiled map, trilinear. `exact` is the level of detail, counted from the coarsest level.
// One loop for all that may be mixed, as some devices go through every branch: the finer level and what its tile fades in
// over, coarser and coarser, then the coarser level in the same way.
fn tiled_lookup(pages: texture_2d_array<f32>, rest: texture_2d<f32>, slot: u32, uv: vec2<f32>, exact: f32) -> vec4<f32> {
    let whole = material.tiled[slot].whole;
    let wrap = vec2(material.wrap & 255u, material.wrap >> 8u);
    let place = vec2(wrapped(uv.x, wrap.x), wrapped(uv.y, wrap.y));
    // Where the texture does not repeat, its outermost texels go on. Where it does, the pages' borders have the others.
    let inset = select(vec2(0.5), vec2(0.0), wrap == vec2(0u));
    let finer = u32(ceil(exact));
    // The texture has as many of the whole levels as are there, and its sampler mixes two.
    let all_whole = finer < whole;
    let top = f32(textureNumLevels(rest)) - 1.0;
    var level = finer;
    var left = 1.0;
    var left_for_coarser = 0.0;
    if (!all_whole) {
        left_for_coarser = f32(finer) - exact;
        left -= left_for_coarser;
    }
    var sum = vec4(0.0);
    loop {
        if (level < whole) {
            let lod = top - select(f32(level), exact, all_whole);
            sum += left * textureSampleLevel(rest, map_sampler, uv, max(lod, 0.0));
            left = 0.0;
        } else {
            let own_size = tiled_size(slot, level);
            let grid = (own_size + TILE_SIDE - 1u) / TILE_SIDE;
            let own_place = clamp(place * vec2<f32>(own_size), inset, vec2<f32>(own_size) - inset);
            let own_tile = min(vec2<u32>(own_place) / TILE_SIDE, grid - 1u);
            let number = level - whole;
            let at = material.tiled[slot].tables[number / 4u][number % 4u] + own_tile.y * grid.x + own_tile.x;
            let word = textureLoad(page_table, vec2(at % PAGE_TABLE_WIDTH, at / PAGE_TABLE_WIDTH), 0).x;
            let there = (word >> 12u) & 31u;
            if (there >= whole) {
                let size = tiled_size(slot, there);
                let tile = min(own_tile >> vec2(level - there), (size - 1u) / TILE_SIDE);
                let inside = clamp(place * vec2<f32>(size), inset, vec2<f32>(size) - inset) - vec2<f32>(tile * TILE_SIDE);
                let share = left * f32(word >> 24u) / 255.0;
                sum += share * page_texel(pages, word & 4095u, inside);
                left -= share;
            }
            level = max(there, whole) - 1u;
        }
        if (left <= 0.001) {
            if (left_for_coarser <= 0.001) {
                break;
            }
            left = left_for_coarser;
            left_for_coarser = 0.0;
            level = finer - 1u;
        }
    }
    return sum;
}

// A tiled map filtered over a footprint of at most so many lookups.
fn tiled_filtered(
    pages: texture_2d_array<f32>, rest: texture_2d<f32>, slot: u32,
    uv: vec2<f32>, dx: vec2<f32>, dy: vec2<f32>, most: f32,
) -> vec4<f32> {
    let size = vec2<f32>(material.tiled[slot].size);
    let f = footprint_of(dx, dy, size, most);
    let finest = f32(material.tiled[slot].levels - 1u);
    let across = max(max(length(f.dx * size), length(f.dy * size)), 1e-6);
    var level = finest - clamp(log2(across), 0.0, finest);
    if ((frame.flags & 32u) != 0u) {
        level = round(level);
    }
    var sum = vec4(0.0);
    for (var i = 0; i < f.count; i++) {
        sum += tiled_lookup(pages, rest, slot, looked_up(f, uv, i), level);
    }
    return sum / f32(f.count);
}

// Any but the emission map.
fn filtered(map: texture_2d<f32>, slot: u32, at: Lookup) -> vec4<f32> {
    if (TILED && material.tiled[slot].levels > 0u) {
        if (slot == COLOUR) {
            return tiled_filtered(colour_pages, map, slot, at.uv, at.dx, at.dy, abs(frame.lookups));
        }
        return tiled_filtered(other_pages, map, slot, at.uv, at.dx, at.dy, abs(frame.lookups));
    }
    return anisotropic(map, map_sampler, at.uv, footprint(at.dx, at.dy, vec2<f32>(textureDimensions(map))));
}

// The emission map. As many lookups as the sampler would take.
fn emitted(uv: vec2<f32>) -> vec3<f32> {
    let dx = dpdx(uv);
    let dy = dpdy(uv);
    if (TILED && material.tiled[EMISSION].levels > 0u) {
        return tiled_filtered(colour_pages, emission_map, EMISSION, uv, dx, dy, -frame.lookups).rgb;
    }
    return textureSampleGrad(emission_map, map_sampler, uv, dx, dy).rgb;
}

// Opacity of the colour map, for passes that draw nothing but depth. As many lookups as the sampler would take.
fn map_opacity(uv: vec2<f32>) -> f32 {
    if (TILED && material.tiled[COLOUR].levels > 0u) {
        return tiled_filtered(colour_pages, colour_map, COLOUR, uv, dpdx(uv), dpdy(uv), -frame.lookups).a;
    }
    return textureSample(colour_map, map_sampler, uv).a;
}
