#![no_main]
libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    let _ = lodestream_fuzz::targets::image_import(data);
});
