//! A gallery: the settled scene as it is shown, then without each technique, by each other way, and by each view for
//! developers; each with how far it is from the first picture, what its frame takes, and where the method comes from.

use std::fmt;
use std::path::Path;
use std::sync::Arc;

use anyhow::Context as _;
use image::codecs::jpeg::JpegEncoder;
use image::{DynamicImage, RgbaImage};
use lodestream_protocol::source::SceneSource;
use lodestream_render::{
    AmbientOcclusion, AntiAliasing, Bloom, DebugView, Gpu, Ink, OcclusionMethod, OcclusionNormals,
    PnTriangles, ReflectionMethod, Reflections, ReliefMethod, STILL_FRAMES, Settings, ToneMapping,
};
use lodestream_scenario::plan::Plan;
use lodestream_scenario::stopwatch::{paired_ratio, rounded};
use lodestream_scene::description::Camera;
use lodestream_scene::view::View;
use serde::Serialize;

use super::painter::{Painter, Studio};
use super::settled::{by_turns, settle, settle_at};
use crate::image_error::image_error;

/// Quality of the pictures' files, of 100.
const JPEG_QUALITY: u8 = 82;
/// Frames until a picture that gathers over frames has all of them.
const GATHERED_FRAMES: u32 = 64;
/// The page's file.
const PAGE: &str = "README.md";

/// A part of the gallery.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Part {
    /// Everything at its default.
    Usual,
    /// One technique is left out.
    Without,
    /// One technique another way.
    Otherwise,
    /// The same and others where a second camera looks.
    Elsewhere,
    /// What passes hand on, for developers.
    View,
}

impl Part {
    const ALL: [Self; 5] = [Self::Usual, Self::Without, Self::Otherwise, Self::Elsewhere, Self::View];

    const fn title(self) -> &'static str {
        match self {
            Self::Usual => "As it is shown",
            Self::Without => "Without one technique",
            Self::Otherwise => "Another way",
            Self::Elsewhere => "At another place",
            Self::View => "Views for developers",
        }
    }
}

/// What is drawn, and what is to be said of it.
struct Entry {
    part: Part,
    name: String,
    settings: Settings,
    /// Frames that are drawn until the picture is taken.
    frames: u32,
    source: &'static str,
}

/// A picture that was drawn.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Shown {
    /// Where it stands.
    pub part: Part,
    /// What it is.
    pub name: String,
    /// The picture's file, in the gallery's folder.
    pub file: String,
    /// How far it is from the usual picture. `None` of that itself and of views, which show something else.
    pub flip: Option<f64>,
    /// What a frame takes over the usual one: the median over frames drawn one after the other. `None` likewise, and of
    /// what is gathered over frames.
    pub over_usual: Option<f64>,
    /// Where the method comes from.
    pub source: &'static str,
}

/// Everything the gallery shows.
fn entries() -> Vec<Entry> {
    let usual = Settings::default();
    let some = AmbientOcclusion::default();
    let one = |part, name: &str, settings, source| Entry {
        part,
        name: name.to_owned(),
        settings,
        frames: 1,
        source,
    };
    let without = |name, settings, source| one(Part::Without, name, settings, source);
    let mut all = vec![
        one(Part::Usual, "everything at its default", usual, ""),
        without("relief", Settings { relief: false, ..usual }, "Policarpo, Oliveira, Comba 2005"),
        without(
            "ambient occlusion",
            Settings { occlusion: None, ..usual },
            "Jimenez, Wu, Pesce, Jarabo 2016",
        ),
        without("shadows", Settings { shadows: None, ..usual }, "Williams 1978; Dimitrov 2007 (cascades)"),
        without(
            "punctual-lights",
            Settings { lights: None, ..usual },
            "Olsson, Billeter, Assarsson 2012 (clusters)",
        ),
        without("haze", Settings { haze: false, ..usual }, "Koschmieder 1924"),
        without("smoothed edges", Settings { anti_aliasing: AntiAliasing::None, ..usual }, ""),
        without("water", Settings { water: false, ..usual }, "Schlick 1994 (reflectance)"),
        without("transparency", Settings { transparency: false, ..usual }, ""),
        without("emission", Settings { emission: false, ..usual }, ""),
        without("filter at grazing angles", Settings { anisotropy: 1, ..usual }, "Heckbert 1989"),
    ];
    for relief_method in ReliefMethod::ALL.into_iter().filter(|&way| way != usual.relief_method) {
        let source = match relief_method {
            ReliefMethod::Parallax => "Kaneko 2001; Welsh 2004",
            ReliefMethod::SteepParallax => "McGuire, McGuire 2005",
            ReliefMethod::ParallaxOcclusion => "Tatarchuk 2006",
            ReliefMethod::Relief => "Policarpo, Oliveira, Comba 2005",
            ReliefMethod::RelaxedCones => "Policarpo, Oliveira 2007",
            ReliefMethod::Quadtree => "Tevs, Ihrke, Seidel 2008; Drobot 2010",
        };
        let name = format!("relief: {}", relief_method.name());
        all.push(one(Part::Otherwise, &name, Settings { relief_method, ..usual }, source));
    }
    for method in OcclusionMethod::ALL.into_iter().filter(|&way| way != some.method) {
        let source = match method {
            OcclusionMethod::Ssao => "Mittring 2007",
            OcclusionMethod::SsaoCentred => "Chapman 2013",
            OcclusionMethod::Hbao => "Bavoil, Sainz, Dimitrov 2008",
            OcclusionMethod::HbaoPlus => "Bavoil 2014",
            OcclusionMethod::Alchemy => "McGuire, Osman, Bukowski, Hennessy 2011",
            OcclusionMethod::Gtao => "Jimenez, Wu, Pesce, Jarabo 2016",
            OcclusionMethod::Bitmask => "Therrien, Levesque, Gilet 2023",
        };
        let settings = Settings { occlusion: Some(AmbientOcclusion { method, ..some }), ..usual };
        all.push(one(Part::Otherwise, &format!("occlusion: {}", method.name()), settings, source));
    }
    let drawn = AmbientOcclusion { normals: OcclusionNormals::Drawn, ..some };
    let half = AmbientOcclusion { half: true, ..some };
    for (name, how) in [("occlusion: by drawn normals", drawn), ("occlusion: half the pixels", half)] {
        all.push(one(Part::Otherwise, name, Settings { occlusion: Some(how), ..usual }, ""));
    }
    let still = AmbientOcclusion { still: Some(OcclusionMethod::Gtao), ..some };
    all.push(Entry {
        frames: STILL_FRAMES + 1,
        ..one(
            Part::Otherwise,
            "occlusion: gtao, mean of 16 frames",
            Settings { occlusion: Some(still), ..usual },
            "Jimenez, Wu, Pesce, Jarabo 2016",
        )
    });
    all.push(Entry {
        frames: GATHERED_FRAMES,
        ..one(
            Part::Otherwise,
            "edges over 64 frames",
            Settings { anti_aliasing: AntiAliasing::Temporal, ..usual },
            "Karis 2014",
        )
    });
    let patches = Settings { pn_triangles: Some(PnTriangles::default()), ..usual };
    all.push(one(Part::Otherwise, "curved triangles", patches, "Vlachos, Peters, Boyd, Mitchell 2001"));
    let ink = Settings { ink: Some(Ink::default()), ..usual };
    all.push(one(Part::Otherwise, "ink", ink, "Cole, Finkelstein 2010"));
    let bloom = Settings { bloom: Some(Bloom::default()), ..usual };
    all.push(one(Part::Otherwise, "bloom", bloom, "Jimenez 2014"));
    let own = Settings { relief_shadows: true, ..usual };
    all.push(one(Part::Otherwise, "relief: with its shadows", own, "Policarpo, Oliveira, Comba 2005"));
    let deep = Settings { relief_in_depth: true, ..usual };
    all.push(one(Part::Otherwise, "relief: in depth", deep, "Policarpo, Oliveira, Comba 2005"));
    let neutral = Settings { tone_mapping: ToneMapping::Neutral, ..usual };
    all.push(one(Part::Otherwise, "tone mapping: neutral", neutral, "Khronos 2024"));
    for shade in DebugView::ALL.into_iter().filter(|&shade| shade != usual.debug_view) {
        all.push(one(Part::View, shade.name(), Settings { debug_view: shade, ..usual }, ""));
    }
    all.push(one(Part::View, "wireframe", Settings { wireframe: true, ..usual }, ""));
    all
}

/// What the gallery shows where a second camera looks.
fn elsewhere() -> Vec<Entry> {
    let usual = Settings::default();
    let one = |name: &str, settings, source| Entry {
        part: Part::Elsewhere,
        name: name.to_owned(),
        settings,
        frames: 1,
        source,
    };
    let mirrored = |method, steps| Settings { reflections: Some(Reflections { method, steps }), ..usual };
    vec![
        one("all at its default", usual, ""),
        one(
            "reflections: hi-z, 100 steps",
            mirrored(ReflectionMethod::HiZ, Reflections::default().steps),
            "Uludag 2014",
        ),
        one("reflections: linear, 150 steps", mirrored(ReflectionMethod::Linear, 150), "McGuire, Mara 2014"),
        one("no water", Settings { water: false, ..usual }, "Schlick 1994 (reflectance)"),
    ]
}

/// Settles the plan's case, draws all of the gallery into a folder, times so many frames of each, and writes the page.
///
/// # Errors
/// A plan of more than one case, or of another technique; runs that do not settle; whatever ends a run early, what the
/// graphics device refuses, and a folder that cannot be written.
pub fn gallery(
    plan: &Plan,
    scene: &Arc<dyn SceneSource>,
    gpu: Gpu,
    frames: u32,
    camera: Option<Camera>,
    folder: &Path,
) -> anyhow::Result<Vec<Shown>> {
    let adapter = gpu.describe();
    let studio = Studio::new(gpu);
    let mut settled = settle(plan, scene, &studio, [plan.client])?;
    let one = settled.first_mut().context("nothing has settled")?;
    let mut shown = draw(&mut one.painter, &one.view, &entries(), frames, folder)?;
    if let Some(camera) = camera {
        let view = camera.view(plan.viewport_px, plan.client.target_px);
        let mut painter = settle_at(plan, scene, &studio, view)?;
        shown.extend(draw(&mut painter, &view, &elsewhere(), frames, folder)?);
    }
    let page = page(&shown, plan.viewport_px, &adapter, frames);
    let path = folder.join(PAGE);
    std::fs::write(&path, page).with_context(|| path.display().to_string())?;
    Ok(shown)
}

/// Draws entries of one view, of which the first is what the others are held against.
fn draw(
    painter: &mut Painter<'_>,
    view: &View,
    entries: &[Entry],
    frames: u32,
    folder: &Path,
) -> anyhow::Result<Vec<Shown>> {
    let mut pictures: Vec<RgbaImage> = Vec::with_capacity(entries.len());
    for entry in entries {
        for _ in 0..entry.frames {
            painter.frame(view, entry.settings)?;
        }
        pictures.push(painter.picture()?);
    }
    let timed: Vec<&Entry> = entries.iter().filter(|entry| entry.is_timed()).collect();
    let seconds = by_turns(timed.len(), frames, |i| painter.frame(view, timed[i].settings).map(drop))?;
    std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    let mut shown = Vec::with_capacity(entries.len());
    for (number, (entry, picture)) in entries.iter().zip(&pictures).enumerate() {
        let compared = number > 0 && entry.part != Part::View;
        // What a scene has not, or a view does not show.
        if entry.part == Part::Without && *picture == pictures[0] {
            continue;
        }
        let file = format!("{}.jpg", slug(entry));
        write_jpeg(&folder.join(&file), picture)?;
        let flip = compared.then(|| image_error(picture, &pictures[0])).transpose()?.map(|error| error.flip);
        let at = timed.iter().position(|other| std::ptr::eq(*other, entry)).filter(|_| compared);
        let over_usual = at.map(|at| rounded(paired_ratio(&seconds[at], &seconds[0]), 2));
        let Entry { part, name, source, .. } = entry;
        shown.push(Shown { part: *part, name: name.clone(), file, flip, over_usual, source });
    }
    Ok(shown)
}

impl Entry {
    /// Views may stop before they are lit, and what gathers restarts where others are drawn between.
    fn is_timed(&self) -> bool {
        self.part != Part::View && self.frames == 1
    }
}

/// A name of letters, digits and dashes.
fn slug(entry: &Entry) -> String {
    let prefix = match entry.part {
        Part::Usual => "",
        Part::Without => "without-",
        Part::Otherwise => "",
        Part::Elsewhere => "elsewhere-",
        Part::View => "view-",
    };
    let mut slug = prefix.to_owned();
    for c in entry.name.chars() {
        if c.is_ascii_alphanumeric() {
            slug.push(c.to_ascii_lowercase());
        } else if !slug.ends_with('-') {
            slug.push('-');
        }
    }
    slug
}

fn write_jpeg(path: &Path, picture: &RgbaImage) -> anyhow::Result<()> {
    let mut bytes = Vec::new();
    let opaque = DynamicImage::ImageRgba8(picture.clone()).to_rgb8();
    opaque.write_with_encoder(JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY))?;
    std::fs::write(path, bytes).with_context(|| path.display().to_string())
}

/// The page, pictures three in a row.
fn page(shown: &[Shown], [width, height]: [u32; 2], adapter: &str, frames: u32) -> String {
    let mut page = format!(
        "# Gallery\n\n*What does each technique do to the picture, and what does it cost?*\n\nWritten by\n\n```sh\n\
         lodestream-sim gallery sim/plans/gallery.toml -o docs/gallery \\\n    --view -95,8,60,-160,-2,-40\n```\n\n\
         The demo settled at one pixel, {width}×{height}, drawn by\n{adapter}.\n\
         FLIP is how far a picture is from the first of its place, at 67 pixels a degree; time is that of a frame over the\n\
         first's, the median of {frames} that are drawn by turns: machines differ. What the view does not show is left out.\n\
         Errors against what is true, not against the default: [drawing](../benchmarks/drawing.md),\n\
         [occlusion](../benchmarks/occlusion.md), [surfaces](../benchmarks/surfaces.md),\n\
         [reflections](../benchmarks/reflections.md), [curved triangles](../benchmarks/pn-triangles.md),\n[ink](../benchmarks/ink.md).\n"
    );
    for part in Part::ALL {
        page.push_str(&format!("\n## {}\n\n| | | |\n|---|---|---|\n", part.title()));
        let of_part: Vec<&Shown> = shown.iter().filter(|one| one.part == part).collect();
        for row in of_part.chunks(3) {
            for one in row {
                page.push_str(&format!("| {one} "));
            }
            page.push_str(&"| ".repeat(3 - row.len()));
            page.push_str("|\n");
        }
    }
    page
}

/// As a cell of the page's tables.
impl fmt::Display for Shown {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, file, flip, over_usual, source, .. } = self;
        write!(f, "![{name}]({file})<br>**{name}**")?;
        if let Some(flip) = flip {
            write!(f, "<br>FLIP {flip:.4}")?;
        }
        if let Some(over) = over_usual {
            write!(f, ", time {over:.2}")?;
        }
        if !source.is_empty() {
            write!(f, "<br>{source}")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::super::open_device;
    use super::super::tests::may_draw;
    use super::*;
    use crate::tests::small_scene;
    use lodestream_scenario::plan;

    const CAMERA: Camera =
        Camera { eye: [2.0, 3.0, 20.0], target: [0.0, 2.0, 0.0], up: [0.0, 1.0, 0.0], fov_y: 0.9 };

    #[test]
    fn every_way_and_view_is_in_the_gallery_once() {
        let entries = entries();
        let files: BTreeSet<String> = entries.iter().chain(&elsewhere()).map(slug).collect();
        assert_eq!(files.len(), entries.len() + elsewhere().len());
        let views = entries.iter().filter(|entry| entry.part == Part::View).count();
        assert_eq!(views, DebugView::ALL.len(), "all but the usual one, and the wireframe");
        for method in OcclusionMethod::ALL {
            let has =
                |e: &Entry| e.settings.occlusion.is_some_and(|o| o.method == method && o.still.is_none());
            assert!(entries.iter().any(has), "{}", method.name());
        }
        for way in ReliefMethod::ALL {
            assert!(entries.iter().any(|e| e.settings.relief_method == way), "{}", way.name());
        }
        let usual = &entries[0].settings;
        assert!(entries[1..].iter().all(|entry| entry.settings != *usual), "each differs from the usual");
    }

    #[test]
    fn a_page_shows_what_was_drawn() {
        if !may_draw() {
            return;
        }
        let text = "scene = \"demo-small\"\nviewport_px = [96, 54]\n[[sweep]]\ntransport = \"quic\"\n\
                    rate_bits_per_s = 16_000_000\nrtt_ms = 50\n";
        let plan = plan::parse(text, Path::new("test.toml")).unwrap();
        let gpu = open_device().expect("a graphics adapter (or LODESTREAM_SKIP_GPU=1)");
        let folder = tempfile::tempdir().unwrap();
        let shown = gallery(&plan, &small_scene(), gpu, 1, Some(CAMERA), folder.path()).unwrap();
        let page = std::fs::read_to_string(folder.path().join(PAGE)).unwrap();
        for one in &shown {
            let picture = image::open(folder.path().join(&one.file)).unwrap();
            assert_eq!((picture.width(), picture.height()), (96, 54));
            assert!(page.contains(&format!("]({})", one.file)), "{}", one.file);
            let compared = matches!(one.part, Part::Without | Part::Otherwise | Part::Elsewhere);
            assert_eq!(one.flip.is_some(), compared && one.name != "all at its default");
        }
        let flip = |name: &str| shown.iter().find(|one| one.name == name).and_then(|one| one.flip).unwrap();
        assert!(flip("shadows") > 0.001 && flip("relief") > 0.0005, "{shown:?}");
    }
}
