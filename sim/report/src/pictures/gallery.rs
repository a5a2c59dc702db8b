//! The gallery: the settled scene by default, with one technique off, with each alternative, and in each debug view;
//! each with its FLIP error against the first picture, its relative frame time, and the method's source.

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

/// JPEG quality, of 100.
const JPEG_QUALITY: u8 = 82;
/// Frames until temporal accumulation has converged.
const GATHERED_FRAMES: u32 = 64;
/// File name of the page.
const PAGE: &str = "README.md";

/// A part of the gallery.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Part {
    /// Everything at its default.
    Default,
    /// One technique turned off.
    TechniqueOff,
    /// One technique replaced by another method.
    Alternative,
    /// A second camera, for techniques that the first does not show.
    OtherPlace,
    /// Intermediate results of the renderer.
    DebugView,
}

impl Part {
    const ALL: [Self; 5] =
        [Self::Default, Self::TechniqueOff, Self::Alternative, Self::OtherPlace, Self::DebugView];

    const fn title(self) -> &'static str {
        match self {
            Self::Default => "Default",
            Self::TechniqueOff => "One technique off",
            Self::Alternative => "Alternatives",
            Self::OtherPlace => "Another place",
            Self::DebugView => "Debug views",
        }
    }
}

/// A picture to draw.
struct Entry {
    part: Part,
    name: String,
    settings: Settings,
    /// Frames drawn before the picture is taken.
    frames: u32,
    source: &'static str,
}

/// A picture that was drawn.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GalleryPicture {
    /// Its part of the gallery.
    pub part: Part,
    /// Its caption.
    pub name: String,
    /// Its file, in the gallery's folder.
    pub file: String,
    /// FLIP error against the place's first picture. `None` for that picture and for debug views.
    pub flip: Option<f64>,
    /// Frame time relative to the first picture: the median over consecutive frames. `None` likewise, and for pictures
    /// accumulated over frames.
    pub over_usual: Option<f64>,
    /// Source of the method.
    pub source: &'static str,
}

/// All pictures at the first camera.
fn entries() -> Vec<Entry> {
    let defaults = Settings::default();
    let some = AmbientOcclusion::default();
    let one = |part, name: &str, settings, source| Entry {
        part,
        name: name.to_owned(),
        settings,
        frames: 1,
        source,
    };
    let without = |name, settings, source| one(Part::TechniqueOff, name, settings, source);
    let mut all = vec![
        one(Part::Default, "everything at its default", defaults, ""),
        without("relief", Settings { relief: false, ..defaults }, "Policarpo, Oliveira, Comba 2005"),
        without(
            "ambient occlusion",
            Settings { occlusion: None, ..defaults },
            "Jimenez, Wu, Pesce, Jarabo 2016",
        ),
        without("shadows", Settings { shadows: None, ..defaults }, "Williams 1978; Dimitrov 2007 (cascades)"),
        without(
            "punctual-lights",
            Settings { lights: None, ..defaults },
            "Olsson, Billeter, Assarsson 2012 (clusters)",
        ),
        without("haze", Settings { haze: false, ..defaults }, "Koschmieder 1924"),
        without("smoothed edges", Settings { anti_aliasing: AntiAliasing::None, ..defaults }, ""),
        without("water", Settings { water: false, ..defaults }, "Schlick 1994 (reflectance)"),
        without("transparency", Settings { transparency: false, ..defaults }, ""),
        without("emission", Settings { emission: false, ..defaults }, ""),
        without("filter at grazing angles", Settings { anisotropy: 1, ..defaults }, "Heckbert 1989"),
    ];
    for relief_method in ReliefMethod::ALL.into_iter().filter(|&way| way != defaults.relief_method) {
        let source = match relief_method {
            ReliefMethod::Parallax => "Kaneko 2001; Welsh 2004",
            ReliefMethod::SteepParallax => "McGuire, McGuire 2005",
            ReliefMethod::ParallaxOcclusion => "Tatarchuk 2006",
            ReliefMethod::Relief => "Policarpo, Oliveira, Comba 2005",
            ReliefMethod::RelaxedCones => "Policarpo, Oliveira 2007",
            ReliefMethod::Quadtree => "Tevs, Ihrke, Seidel 2008; Drobot 2010",
        };
        let name = format!("relief: {}", relief_method.name());
        all.push(one(Part::Alternative, &name, Settings { relief_method, ..defaults }, source));
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
        let settings = Settings { occlusion: Some(AmbientOcclusion { method, ..some }), ..defaults };
        all.push(one(Part::Alternative, &format!("occlusion: {}", method.name()), settings, source));
    }
    let drawn = AmbientOcclusion { normals: OcclusionNormals::Drawn, ..some };
    let half = AmbientOcclusion { half: true, ..some };
    for (name, how) in [("occlusion: by drawn normals", drawn), ("occlusion: half the pixels", half)] {
        all.push(one(Part::Alternative, name, Settings { occlusion: Some(how), ..defaults }, ""));
    }
    let still = AmbientOcclusion { still: Some(OcclusionMethod::Gtao), ..some };
    all.push(Entry {
        frames: STILL_FRAMES + 1,
        ..one(
            Part::Alternative,
            "occlusion: gtao, mean of 16 frames",
            Settings { occlusion: Some(still), ..defaults },
            "Jimenez, Wu, Pesce, Jarabo 2016",
        )
    });
    all.push(Entry {
        frames: GATHERED_FRAMES,
        ..one(
            Part::Alternative,
            "edges over 64 frames",
            Settings { anti_aliasing: AntiAliasing::Temporal, ..defaults },
            "Karis 2014",
        )
    });
    let patches = Settings { pn_triangles: Some(PnTriangles::default()), ..defaults };
    all.push(one(Part::Alternative, "curved triangles", patches, "Vlachos, Peters, Boyd, Mitchell 2001"));
    let ink = Settings { ink: Some(Ink::default()), ..defaults };
    all.push(one(Part::Alternative, "ink", ink, "Cole, Finkelstein 2010"));
    let bloom = Settings { bloom: Some(Bloom::default()), ..defaults };
    all.push(one(Part::Alternative, "bloom", bloom, "Jimenez 2014"));
    let own = Settings { relief_shadows: true, ..defaults };
    all.push(one(Part::Alternative, "relief: with its shadows", own, "Policarpo, Oliveira, Comba 2005"));
    let deep = Settings { relief_in_depth: true, ..defaults };
    all.push(one(Part::Alternative, "relief: in depth", deep, "Policarpo, Oliveira, Comba 2005"));
    let neutral = Settings { tone_mapping: ToneMapping::Neutral, ..defaults };
    all.push(one(Part::Alternative, "tone mapping: neutral", neutral, "Khronos 2024"));
    for shade in DebugView::ALL.into_iter().filter(|&shade| shade != defaults.debug_view) {
        all.push(one(Part::DebugView, shade.name(), Settings { debug_view: shade, ..defaults }, ""));
    }
    all.push(one(Part::DebugView, "wireframe", Settings { wireframe: true, ..defaults }, ""));
    all
}

/// All pictures at the second camera.
fn elsewhere() -> Vec<Entry> {
    let defaults = Settings::default();
    let one = |name: &str, settings, source| Entry {
        part: Part::OtherPlace,
        name: name.to_owned(),
        settings,
        frames: 1,
        source,
    };
    let mirrored = |method, steps| Settings { reflections: Some(Reflections { method, steps }), ..defaults };
    vec![
        one("all at its default", defaults, ""),
        one(
            "reflections: hi-z, 100 steps",
            mirrored(ReflectionMethod::HiZ, Reflections::default().steps),
            "Uludag 2014",
        ),
        one("reflections: linear, 150 steps", mirrored(ReflectionMethod::Linear, 150), "McGuire, Mara 2014"),
        one("no water", Settings { water: false, ..defaults }, "Schlick 1994 (reflectance)"),
    ]
}

/// Settles the plan's case, draws the gallery into a folder, times `frames` frames of each entry, and writes the page.
///
/// # Errors
/// A plan with several cases or another technique; runs that do not settle or end early; errors of the graphics device
/// or the folder.
pub fn gallery(
    plan: &Plan,
    scene: &Arc<dyn SceneSource>,
    gpu: Gpu,
    frames: u32,
    camera: Option<Camera>,
    folder: &Path,
) -> anyhow::Result<Vec<GalleryPicture>> {
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

/// Draws the entries of one view; the first is the reference of the others.
fn draw(
    painter: &mut Painter<'_>,
    view: &View,
    entries: &[Entry],
    frames: u32,
    folder: &Path,
) -> anyhow::Result<Vec<GalleryPicture>> {
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
        let compared = number > 0 && entry.part != Part::DebugView;
        // The scene lacks the technique, or the view does not show it.
        if entry.part == Part::TechniqueOff && *picture == pictures[0] {
            continue;
        }
        let file = format!("{}.jpg", slug(entry));
        write_jpeg(&folder.join(&file), picture)?;
        let flip = compared.then(|| image_error(picture, &pictures[0])).transpose()?.map(|error| error.flip);
        let at = timed.iter().position(|other| std::ptr::eq(*other, entry)).filter(|_| compared);
        let over_usual = at.map(|at| rounded(paired_ratio(&seconds[at], &seconds[0]), 2));
        let Entry { part, name, source, .. } = entry;
        shown.push(GalleryPicture { part: *part, name: name.clone(), file, flip, over_usual, source });
    }
    Ok(shown)
}

impl Entry {
    /// Debug views may stop before lighting, and accumulation restarts when other entries are drawn in between.
    fn is_timed(&self) -> bool {
        self.part != Part::DebugView && self.frames == 1
    }
}

/// File name without extension: letters, digits and hyphens.
fn slug(entry: &Entry) -> String {
    let prefix = match entry.part {
        Part::Default => "",
        Part::TechniqueOff => "without-",
        Part::Alternative => "",
        Part::OtherPlace => "elsewhere-",
        Part::DebugView => "view-",
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

/// The page, with three pictures per row.
fn page(shown: &[GalleryPicture], [width, height]: [u32; 2], adapter: &str, frames: u32) -> String {
    let mut page = format!(
        "# Gallery\n\nEach technique and debug view, with difference and cost:\n\n```sh\n\
         lodestream-sim gallery sim/plans/gallery.toml -o docs/gallery \\\n    --view -95,8,60,-160,-2,-40\n```\n\n\
         The demo, settled at one pixel, {width}×{height}, drawn by {adapter}. FLIP (67 pixels a degree)\n\
         compares with a place's first picture, time with its frame time (median of {frames}). Invisible effects are left \
         out. Errors\nagainst references: [drawing](../benchmarks/drawing.md),\n\
         [occlusion](../benchmarks/occlusion.md), [surfaces](../benchmarks/surfaces.md),\n\
         [reflections](../benchmarks/reflections.md), [curved triangles](../benchmarks/pn-triangles.md),\n\
         [ink](../benchmarks/ink.md).\n"
    );
    for part in Part::ALL {
        page.push_str(&format!("\n## {}\n\n| | | |\n|---|---|---|\n", part.title()));
        let of_part: Vec<&GalleryPicture> = shown.iter().filter(|one| one.part == part).collect();
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

/// Formats a picture as a table cell.
impl fmt::Display for GalleryPicture {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, file, flip, over_usual, source, .. } = self;
        write!(f, "![]({file})<br>**{name}**")?;
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

    use super::super::tests::plan_and_device;
    use super::*;
    use lodestream_scenario::testing::small_scene;

    const CAMERA: Camera =
        Camera { eye: [2.0, 3.0, 20.0], target: [0.0, 2.0, 0.0], up: [0.0, 1.0, 0.0], fov_y: 0.9 };

    #[test]
    fn every_method_and_debug_view_is_in_the_gallery_once() {
        let entries = entries();
        let files: BTreeSet<String> = entries.iter().chain(&elsewhere()).map(slug).collect();
        assert_eq!(files.len(), entries.len() + elsewhere().len());
        let views = entries.iter().filter(|entry| entry.part == Part::DebugView).count();
        assert_eq!(views, DebugView::ALL.len(), "all but the default view, and the wireframe");
        for method in OcclusionMethod::ALL {
            let has =
                |e: &Entry| e.settings.occlusion.is_some_and(|o| o.method == method && o.still.is_none());
            assert!(entries.iter().any(has), "{}", method.name());
        }
        for way in ReliefMethod::ALL {
            assert!(entries.iter().any(|e| e.settings.relief_method == way), "{}", way.name());
        }
        let defaults = &entries[0].settings;
        assert!(
            entries[1..].iter().all(|entry| entry.settings != *defaults),
            "each differs from the default"
        );
    }

    /// A rerun of the command must not change the page's text.
    #[test]
    fn the_committed_page_has_this_text() {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/gallery").join(PAGE);
        let committed = std::fs::read_to_string(file).unwrap();
        let page = page(&[], [480, 270], "llvmpipe (LLVM 15.0.6, 256 bits) (Vulkan)", 5);
        let (introduction, _) = page.split_once("\n## ").unwrap();
        assert!(committed.starts_with(introduction), "{introduction}");
        let titles = |page: &str| -> Vec<String> {
            page.lines().filter(|line| line.starts_with('#')).map(str::to_owned).collect()
        };
        assert_eq!(titles(&committed), titles(&page));
    }

    #[test]
    fn a_page_shows_what_was_drawn() {
        let Some((plan, gpu)) = plan_and_device("[96, 54]") else { return };
        let folder = tempfile::tempdir().unwrap();
        let shown = gallery(&plan, &small_scene(), gpu, 1, Some(CAMERA), folder.path()).unwrap();
        let page = std::fs::read_to_string(folder.path().join(PAGE)).unwrap();
        for one in &shown {
            let picture = image::open(folder.path().join(&one.file)).unwrap();
            assert_eq!((picture.width(), picture.height()), (96, 54));
            assert!(page.contains(&format!("]({})", one.file)), "{}", one.file);
            let compared = matches!(one.part, Part::TechniqueOff | Part::Alternative | Part::OtherPlace);
            assert_eq!(one.flip.is_some(), compared && one.name != "all at its default");
        }
        let flip = |name: &str| shown.iter().find(|one| one.name == name).and_then(|one| one.flip).unwrap();
        assert!(flip("shadows") > 0.001 && flip("relief") > 0.0005, "{shown:?}");
    }
}
