//! The terrain: a valley with the temple, ridges on both sides, mountains at its end and a river bed. Features are at
//! the same places for every seed; the random offsets between them differ.

use std::fmt::Write as _;

/// Height of the levelled site: a little below y = 0, on which the temple stands.
const SITE: f64 = -0.04;
/// Mean height of the terrain around; heights of fixed stamps are relative to it.
const BASE: f64 = 34.0;
/// Height of the river's surface, and the depth at which its water lets a tenth of green light through.
const WATER: [f64; 2] = [-3.5, 4.0];

/// The text of `[terrain]`. Metres.
pub(super) fn terrain_text(seed: u64) -> String {
    let mut text = format!(
        "\n[terrain]\nseed = {seed}\npatch_cells = 1024\npatches = 16\nunit = 1.0\nheight_unit = 0.01\n\
         base = {BASE:.1}\namplitude = 70.0\nroughness = 0.5\nzones = [-6.0, 105.0, 230.0]\n\
         water = {{ level = {:.1}, clarity = {:.1} }}\n",
        WATER[0], WATER[1]
    );
    let mut stamp = |kind: &str, fields: &str| {
        // Writing to a String cannot fail.
        let _ = write!(text, "\n[[terrain.stamp]]\nkind = \"{kind}\"\n{fields}\n");
    };
    stamp("ridge", "from = [-1250, -2600]\nto = [-800, -700]\nhalf_width = 800\nheight = 190");
    stamp("ridge", "from = [-820, -760]\nto = [-1150, 1500]\nhalf_width = 620\nheight = 130");
    stamp("ridge", "from = [700, -2500]\nto = [980, -300]\nhalf_width = 760\nheight = 210");
    stamp("ridge", "from = [960, -340]\nto = [800, 1300]\nhalf_width = 560\nheight = 110");
    stamp("ridge", "from = [-2600, -2500]\nto = [200, -3300]\nhalf_width = 1300\nheight = 380");
    stamp("ridge", "from = [150, -3250]\nto = [2400, -2600]\nhalf_width = 1200\nheight = 330");
    stamp("crater", "centre = [560, 700]\nradius = 120\ndepth = 30\nrim = 12");
    // The valley runs past the temple, from the mountains in the north (−z) to the lowlands in the south. It is fixed,
    // so that its floor is at the site's height for every seed.
    stamp("valley", "mode = \"fixed\"\nfrom = [-60, -1700]\nto = [40, 2600]\nhalf_width = 620\ndepth = 35");
    // From the lake in the north. Fixed too, so that its bed is below the water level everywhere.
    stamp(
        "river bed",
        "mode = \"fixed\"\nsmooth = true\n\
         line = [[90, -560], [-90, -470], [-215, -280], [-125, 40], [-150, 420], [-10, 1000], [60, 2400]]\n\
         half_width = 44\ndepth = 42",
    );
    // The last stamp, so that no other changes the site.
    stamp(
        "plateau",
        &format!(
            "mode = \"fixed\"\ncentre = [0, 14]\nradius = 44\nfalloff = 90\nheight = {:.2}",
            SITE - BASE
        ),
    );
    text
}
