//! The server's program: see [`lodestream_server::cli`].

use lodestream_bake::mapped::Mapped;

#[global_allocator]
static ALLOCATOR: Mapped = Mapped;

fn main() -> std::process::ExitCode {
    lodestream_server::cli::main()
}
