//! Prints the hashes that `tests/suite/golden.txt` pins; `script/terrain-wasm` runs it as wasm32.

#[path = "../tests/suite/golden_cases.rs"]
mod golden_cases;

fn main() -> Result<(), lodestream_terrain::TerrainError> {
    for (name, hash) in golden_cases::hashes()? {
        println!("{hash:016x} {name}");
    }
    Ok(())
}
