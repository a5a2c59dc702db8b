//! Writes the seed inputs into `fuzz/corpus`, each target's into a folder of its own.

use std::path::Path;

use lodestream_fuzz::{seeds, targets};

fn main() -> std::io::Result<()> {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus");
    for (name, _) in targets::ALL {
        let folder = corpus.join(name);
        std::fs::create_dir_all(&folder)?;
        let seeds = seeds::of(name);
        for (file, bytes) in &seeds {
            std::fs::write(folder.join(file), bytes)?;
        }
        println!("{name}: {} seeds", seeds.len());
    }
    Ok(())
}
