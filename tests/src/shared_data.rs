//! Where the shared real scenes are, beside the checkout; tests that need them pass without them and say so.

use std::path::PathBuf;

/// The folder of a shared scene, or `None` after printing that the test is skipped.
pub fn scene(name: &str) -> Option<PathBuf> {
    let folder = root().join(name);
    if folder.is_dir() {
        return Some(folder);
    }
    println!("skipped: no shared data ({} does not exist)", folder.display());
    None
}

/// The folder of all shared scenes, whether it exists or not.
pub fn root() -> PathBuf {
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data"))
}
