//! The city: streets of buildings of parts, as a program for buildings would export it.
//!
//! Each block is a GLB file of nested nodes with names, f64 transformations and extras; another file has the streets,
//! whose trees, lamps and cars are placed many times. Most windows have a mesh of their own even where they are equal.
//!
//! ```text
//! plan: lots by distance -> building, tower -> facade, ledges, roof -> part -> glb
//!                        -> pavements -> street ------------------------^
//! ```

mod building;
mod facade;
mod glb;
mod ledges;
mod materials;
mod part;
mod pavements;
mod pictures;
mod plan;
mod roof;
mod street;
#[cfg(test)]
mod tests;
mod tower;

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use glb::Glb;
use pavements::Streets;
use plan::{Lot, Use};

use crate::{Error, Summary};

/// Options of [`generate`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options {
    /// Seed of the buildings and of what stands in the streets.
    pub seed: u64,
    /// Least number of placed meshes, 100 to 200,000. The last building makes it up to 200 more.
    pub parts: usize,
}

impl Options {
    /// 100,000 parts, 20 million faces.
    #[must_use]
    pub fn full(seed: u64) -> Self {
        Self { seed, parts: 100_000 }
    }
}

/// Range of [`Options::parts`].
const PARTS: std::ops::RangeInclusive<usize> = 100..=200_000;
/// A block has more parts than this.
const LEAST_BLOCK: usize = 64;

/// Generates the city and writes its files into `dir`, which is created if it is missing; files of the same names are
/// replaced. Holds one block and the streets in memory; 100,000 parts take 690 MB on disk.
///
/// # Errors
/// [`Error::Parts`] for a number out of range, [`Error::Write`] when the file system refuses.
pub fn generate(dir: &Path, options: &Options) -> Result<Summary, Error> {
    if !PARTS.contains(&options.parts) {
        return Err(Error::Parts(options.parts));
    }
    let refused = |path: &Path| {
        let path = path.to_owned();
        move |source| Error::Write { path, source }
    };
    std::fs::create_dir_all(dir).map_err(refused(dir))?;
    let mut bytes = 0;
    for (name, picture) in pictures::all(options.seed) {
        let path = dir.join(name);
        crate::images::write(&path, &picture).map_err(refused(&path))?;
        bytes += std::fs::metadata(&path).map_err(refused(&path))?.len();
    }

    let lots = chosen(options);
    let mut streets = Streets::new(Glb::new("streets"), options.seed);
    let mut blocks: BTreeMap<[i64; 2], Vec<Lot>> = BTreeMap::new();
    for lot in lots {
        streets.add(&lot);
        blocks.entry(lot.block).or_default().push(lot);
    }
    let mut summary = Summary {
        assets: 0,
        instances: 0,
        distinct_faces: 0,
        instanced_faces: 0,
        bytes,
        scene: dir.join("scene.toml"),
    };
    let mut files = Vec::new();
    let mut write = |glb: Glb, name: String| {
        summary.assets += glb.meshes();
        summary.instances += glb.parts;
        summary.distinct_faces += glb.distinct_faces();
        summary.instanced_faces += glb.placed_faces;
        let path = dir.join(format!("{name}.glb"));
        summary.bytes += glb.write(&path).map_err(refused(&path))?;
        files.push(name);
        Ok::<(), Error>(())
    };
    write(streets.glb, "streets".to_owned())?;
    for (number, (_, lots)) in blocks.into_iter().enumerate() {
        let name = format!("block-{:03}", number + 1);
        write(block(&format!("block {}", number + 1), &lots), name)?;
    }
    let text = scene_text(&files, options);
    std::fs::write(&summary.scene, &text).map_err(refused(&summary.scene))?;
    summary.bytes += text.len() as u64;
    Ok(summary)
}

/// The nearest lots that have enough parts together.
fn chosen(options: &Options) -> Vec<Lot> {
    // Blocks within a circle that would suffice if each had the least number of parts.
    let reach = ((options.parts / LEAST_BLOCK) as f64).sqrt().ceil() as i64 / 2 + 2;
    let mut streets = Streets::new(Glb::count(), options.seed);
    let mut houses = Glb::count();
    let mut chosen = Vec::new();
    for lot in plan::lots(options.seed, reach) {
        if streets.glb.parts + houses.parts >= options.parts {
            break;
        }
        streets.add(&lot);
        add(&mut houses, 0, &lot);
        chosen.push(lot);
    }
    chosen
}

/// The file of a block with some of its lots.
fn block(name: &str, lots: &[Lot]) -> Glb {
    let mut glb = Glb::new("city");
    if let Some(first) = lots.first() {
        let place = glb::Place::at(plan::middle(first.block));
        let extras = format!("\"column\":{},\"row\":{}", first.block[0], first.block[1]);
        let node = glb.group(0, name, place, extras);
        let mut lots: Vec<&Lot> = lots.iter().collect();
        lots.sort_by_key(|lot| lot.number);
        lots.into_iter().for_each(|lot| add(&mut glb, node, lot));
    }
    glb
}

fn add(glb: &mut Glb, parent: glb::Index, lot: &Lot) {
    match lot.what {
        Use::House => building::add(glb, parent, lot),
        Use::Tower(storeys) => tower::add(glb, parent, lot, storeys),
    }
}

/// The text of `scene.toml`.
fn scene_text(files: &[String], options: &Options) -> String {
    let mut text = format!(
        "# Lodestream's city, seed {}, {} parts or more. Metres, y up.\n\
         name = \"city\"\n\n\
         [light]\ndirection = [0.62, 0.60, 0.50]\ncolor = [1.0, 0.93, 0.82]\nintensity = 1.7\n\n\
         [camera]\neye = [3.4, 4.6, 11.0]\ntarget = [-1.5, 8.2, -40.0]\nfov_y_degrees = 55.0\n",
        options.seed, options.parts
    );
    // Writing to a String cannot fail.
    for name in files {
        let _ = write!(text, "\n[[asset]]\nname = \"{name}\"\nfile = \"{name}.glb\"\n");
    }
    for name in files {
        let _ = write!(text, "\n[[instance]]\nasset = \"{name}\"\n");
    }
    text
}
