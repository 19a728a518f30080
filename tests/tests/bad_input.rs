//! Broken databases end in a typed error or in warnings that say where; nothing panics, nothing half-written stays.

mod common;

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use common::{Listener, check_consistent, check_round_trip};
use epipole_formats::{ReadOptions, read_database, write_model_binary};
use epipole_mapper::{Matches, Options, reconstruct_blocking};
use epipole_optimize::Engine;
use epipole_tests::damage::{self, Verdict};
use epipole_tests::fixtures;

/// Reads, reconstructs and writes as the command line does; returns the warnings, or the error.
fn pipeline(database: &Path, output: &Path, options: &Options) -> Result<Vec<String>, String> {
    let read = ReadOptions { raw_matches: options.matches == Matches::Raw };
    let loaded = read_database(database, &read).map_err(|e| e.to_string())?;
    let mut warnings: Vec<String> = loaded.warnings.iter().map(|w| w.to_string()).collect();
    let mut listener = Listener::default();
    let outcome = reconstruct_blocking(loaded.value, options, &mut Engine::Cpu, None, &mut listener)
        .map_err(|e| e.to_string())?;
    warnings.append(&mut listener.warnings);
    for (i, model) in outcome.reconstructions.iter().enumerate() {
        check_consistent(model);
        check_round_trip(model);
        write_model_binary(&output.join(i.to_string()), model).map_err(|e| e.to_string())?;
    }
    Ok(warnings)
}

#[test]
fn every_damage_has_its_verdict() {
    assert!(damage::ALL.len() >= 20);
    let mut wrong: BTreeMap<&str, String> = BTreeMap::new();
    for damage in damage::ALL {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let (database, output) = (folder.path().join("database.db"), folder.path().join("out"));
        std::fs::copy(fixtures::folder().join("orbit/database.db"), &database).expect("the fixture");
        damage.apply(&database).expect("damage");
        let before = std::fs::read(&database).expect("the database");
        std::fs::create_dir(&output).expect("a folder");
        let result = catch_unwind(AssertUnwindSafe(|| pipeline(&database, &output, &Options::default())));
        let message = match (&result, damage.verdict) {
            (Err(_), _) => "it panicked".into(),
            (Ok(Err(error)), Verdict::Error) if error.contains(damage.mentions) && error.len() > 20 => String::new(),
            (Ok(Ok(warnings)), Verdict::Warning) if warnings.iter().any(|w| w.contains(damage.mentions)) => {
                String::new()
            }
            (Ok(Ok(warnings)), Verdict::Accepted) if warnings.is_empty() => String::new(),
            (Ok(other), expected) => format!("{other:?} instead of {expected:?} mentioning `{}`", damage.mentions),
        };
        if let Ok(result) = &result {
            println!("{}: {result:?}", damage.name);
            let left = std::fs::read_dir(&output).expect("the folder").count();
            if result.is_err() && left != 0 {
                wrong.insert(damage.name, "something was written in spite of the error".into());
            }
        }
        if !message.is_empty() {
            wrong.insert(damage.name, message);
        }
        assert!(before == std::fs::read(&database).expect("the database"), "{}: the input was changed", damage.name);
    }
    let lines: Vec<String> = wrong.iter().map(|(name, what)| format!("{name}: {what}")).collect();
    assert!(lines.is_empty(), "{}", lines.join("\n"));
}

#[test]
fn the_sound_fixture_has_no_warnings() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for matches in [Matches::Verified, Matches::Raw] {
        let database = fixtures::folder().join("orbit/database.db");
        let options = Options { matches, ..Options::default() };
        assert_eq!(pipeline(&database, folder.path(), &options), Ok(vec![]));
    }
}

#[test]
fn a_database_cut_anywhere_never_panics() {
    let whole = std::fs::read(fixtures::folder().join("orbit/database.db")).expect("the fixture");
    let folder = tempfile::tempdir().expect("a temporary folder");
    let database = folder.path().join("database.db");
    for percent in (0..100).step_by(3) {
        let length = whole.len() * percent / 100 + percent % 7;
        std::fs::write(&database, &whole[..length]).expect("writing");
        let result = catch_unwind(|| read_database(&database, &ReadOptions { raw_matches: true }).map(|_| ()));
        assert!(matches!(result, Ok(Err(_))), "cut at {length} of {} bytes: {result:?}", whole.len());
    }
}

#[test]
fn flipped_bytes_never_panic() {
    let whole = std::fs::read(fixtures::folder().join("orbit/database.db")).expect("the fixture");
    let folder = tempfile::tempdir().expect("a temporary folder");
    let database = folder.path().join("database.db");
    for trial in 0..60usize {
        let mut bytes = whole.clone();
        // Steps that are coprime with the length visit headers, cells and blobs alike.
        for k in 0..20 {
            let at = (trial * 7919 + k * 104_729) % bytes.len();
            bytes[at] ^= 1 << (k % 8);
        }
        std::fs::write(&database, &bytes).expect("writing");
        let result = catch_unwind(|| read_database(&database, &ReadOptions { raw_matches: true }).map(|_| ()));
        assert!(result.is_ok(), "trial {trial} panicked");
    }
}
