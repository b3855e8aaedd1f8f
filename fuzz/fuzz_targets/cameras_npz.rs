#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    infonerf_dataset::fuzzing::run("cameras_npz", bytes);
});
