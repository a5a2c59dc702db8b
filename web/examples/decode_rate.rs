//! Decodes and applies all chunks of packs on one thread, natively, for comparison with a worker in a browser
//! (`tests/src/browser/figures.rs`). Prints the milliseconds of each round for each pack, a line per pack.
//!
//! ```sh
//! cargo run --release -p lodestream-web --no-default-features --features checks --example decode_rate -- ROUNDS PACK…
//! ```

use std::time::Instant;

use lodestream_web::PackCheck;

fn main() -> Result<(), String> {
    let mut arguments = std::env::args().skip(1);
    let rounds: u32 =
        arguments.next().and_then(|text| text.parse().ok()).ok_or("name a number of rounds, then packs")?;
    for path in arguments {
        let bytes = std::fs::read(&path).map_err(|why| format!("{path}: {why}"))?;
        let mut pack = PackCheck::new(&bytes).map_err(|why| format!("{path}: {why}"))?;
        let mut times = Vec::new();
        for _ in 0..rounds {
            let begun = Instant::now();
            pack.refine().map_err(|why| format!("{path}: {why}"))?;
            times.push(format!("{:.3}", begun.elapsed().as_secs_f64() * 1e3));
        }
        println!("{}", times.join(" "));
    }
    Ok(())
}
