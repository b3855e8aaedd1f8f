/// JSON schema (draft 2020-12) of `results.json`, for programs in other languages.
pub const RESULTS_SCHEMA: &str = include_str!("../results.schema.json");
