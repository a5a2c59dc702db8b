#![no_main]
libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    let _ = lodestream_fuzz::targets::parts(data);
});
