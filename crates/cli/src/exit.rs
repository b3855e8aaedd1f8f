//! Exit codes other than 0.

/// A run failed, or a bound was exceeded.
pub(crate) const FAILED: u8 = 1;
/// Anything that the user can put right.
pub(crate) const USER_ERROR: u8 = 2;
/// Stopped by Ctrl-C.
pub(crate) const INTERRUPTED: u8 = 130;
