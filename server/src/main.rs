//! The server's program: see [`lodestream_server::cli`].

use lodestream_bake::mapping_allocator::MappingAllocator;

#[global_allocator]
static ALLOCATOR: MappingAllocator = MappingAllocator;

fn main() -> std::process::ExitCode {
    lodestream_server::cli::main()
}
