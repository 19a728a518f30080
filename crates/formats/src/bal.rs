//! Bundle Adjustment in the Large: the text files of Agarwal et al. 2010 (grail.cs.washington.edu/projects/bal).

use std::fs;
use std::path::Path;
use std::str::{FromStr, SplitAsciiWhitespace};

use glam::{DVec2, DVec3};

use crate::atomic::atomic_write;
use crate::error::{FormatError, Location, Problem};
use crate::number::push_f64;

/// A bundle adjustment problem in BAL's own conventions: `P = R X + t`, `p = −P.xy / P.z`,
/// `pixel = f (1 + k1 |p|² + k2 |p|⁴) p`, with the origin at the image centre, x to the right and y up.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BalProblem {
    /// Rodrigues rotation vector (3), translation (3), f, k1, k2.
    pub cameras: Vec<[f64; 9]>,
    /// Points in the world.
    pub points: Vec<DVec3>,
    /// (camera, point, pixel); both indices are below the lengths above when read from a file.
    pub observations: Vec<(u32, u32, DVec2)>,
}

const ADVICE: &str = "give an unpacked BAL text file (problem-….txt)";

/// Least number of bytes of an observation, a camera and a point: one digit and one separator a number.
const LEAST_BYTES: [u64; 3] = [8, 18, 6];

/// Reads a BAL problem.
///
/// # Errors
/// A file that is compressed or cut off, words that are no numbers, indices out of range, numbers that are not finite.
pub fn read_bal(path: &Path) -> Result<BalProblem, FormatError> {
    let bytes = fs::read(path).map_err(|e| FormatError::io(path, e))?;
    parse(&bytes).map_err(|(row, problem)| {
        let place = Location::file(path);
        FormatError::invalid(if row.is_empty() { place } else { place.row(row) }, problem, ADVICE)
    })
}

type Fault = (String, Problem);

struct Words<'a>(SplitAsciiWhitespace<'a>);

impl Words<'_> {
    fn next<T: FromStr>(&mut self, what: &'static str, row: impl Fn() -> String) -> Result<T, Fault> {
        let Some(word) = self.0.next() else {
            return Err((row(), Problem::Syntax { what, found: "the end of the file".into() }));
        };
        word.parse().map_err(|_| (row(), Problem::Syntax { what, found: word.chars().take(60).collect() }))
    }

    fn number(&mut self, row: impl Fn() -> String) -> Result<f64, Fault> {
        let value: f64 = self.next("a number", &row)?;
        if value.is_finite() { Ok(value) } else { Err((row(), Problem::NotFinite("a number".into()))) }
    }
}

fn parse(bytes: &[u8]) -> Result<BalProblem, Fault> {
    let wrong = |reason: String| (String::new(), Problem::WrongKind { expected: "a BAL problem", reason });
    if bytes.starts_with(b"BZh") {
        return Err(wrong("it is compressed; unpack it with bunzip2".into()));
    }
    let text = std::str::from_utf8(bytes).map_err(|_| wrong("it is not text".into()))?;
    let mut words = Words(text.split_ascii_whitespace());
    let header = || "line 1".to_owned();
    let num_cameras: u64 = words.next("a number of cameras", header)?;
    let num_points: u64 = words.next("a number of points", header)?;
    let num_observations: u64 = words.next("a number of observations", header)?;
    let counts = [num_observations, num_cameras, num_points];
    let expected =
        counts.iter().zip(LEAST_BYTES).fold(0u64, |sum, (&n, bytes)| sum.saturating_add(n.saturating_mul(bytes)));
    // One byte fewer for the last separator, which a file need not have.
    if expected > bytes.len() as u64 + 1 {
        return Err((String::new(), Problem::Truncated { expected, found: bytes.len() as u64 }));
    }
    let mut problem = BalProblem {
        cameras: Vec::with_capacity(num_cameras as usize),
        points: Vec::with_capacity(num_points as usize),
        observations: Vec::with_capacity(num_observations as usize),
    };
    for index in 0..num_observations {
        let row = || format!("observation {index}");
        let camera: u32 = words.next("a camera index", row)?;
        let point: u32 = words.next("a point index", row)?;
        for (what, id, count) in [("camera", camera, num_cameras), ("point", point, num_points)] {
            if u64::from(id) >= count {
                return Err((row(), Problem::Dangling { what, id: id.to_string() }));
            }
        }
        problem.observations.push((camera, point, DVec2::new(words.number(row)?, words.number(row)?)));
    }
    for index in 0..num_cameras {
        let mut camera = [0.0; 9];
        for value in &mut camera {
            *value = words.number(|| format!("camera {index}"))?;
        }
        problem.cameras.push(camera);
    }
    for index in 0..num_points {
        let row = || format!("point {index}");
        problem.points.push(DVec3::new(words.number(row)?, words.number(row)?, words.number(row)?));
    }
    Ok(problem)
}

/// Writes a BAL problem; every number reads back to the same bits. Atomic.
///
/// # Errors
/// Whatever the file system refuses.
pub fn write_bal(path: &Path, problem: &BalProblem) -> Result<(), FormatError> {
    let mut out = format!("{} {} {}\n", problem.cameras.len(), problem.points.len(), problem.observations.len());
    for (camera, point, px) in &problem.observations {
        out.push_str(&format!("{camera} {point} "));
        push_f64(&mut out, px.x);
        out.push(' ');
        push_f64(&mut out, px.y);
        out.push('\n');
    }
    let points = problem.points.iter().flat_map(|p| p.to_array());
    for value in problem.cameras.iter().flatten().copied().chain(points) {
        push_f64(&mut out, value);
        out.push('\n');
    }
    atomic_write(path, |writer| writer.write_all(out.as_bytes()).map_err(|e| FormatError::io(path, e)))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn small() -> BalProblem {
        BalProblem {
            cameras: vec![[0.1, -0.2, 0.3, 1.0, 2.0, -3.0, 500.0, -1e-7, 3e-14]],
            points: vec![DVec3::new(0.1, 0.2, -0.3), DVec3::new(1e300, 5e-324, 0.0)],
            observations: vec![(0, 1, DVec2::new(-332.65, 262.09)), (0, 0, DVec2::new(1.0 / 3.0, -0.0))],
        }
    }

    #[test]
    fn round_trip() {
        let dir = tempfile::tempdir().expect("temp dir");
        let path = dir.path().join("p.txt");
        write_bal(&path, &small()).expect("write");
        assert_eq!(read_bal(&path).expect("read"), small());
    }

    #[test]
    fn real_problem_has_its_known_cost() {
        let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data/bal/problem-49-7776-pre.txt"));
        if !path.exists() {
            return println!("skipped: no shared data");
        }
        let problem = read_bal(path).expect("read");
        assert_eq!([problem.cameras.len(), problem.points.len(), problem.observations.len()], [49, 7776, 31843]);
        let cost: f64 = problem
            .observations
            .iter()
            .map(|&(c, p, px)| {
                let [rx, ry, rz, tx, ty, tz, f, k1, k2] = problem.cameras[c as usize];
                let rotation = glam::DQuat::from_scaled_axis(DVec3::new(rx, ry, rz));
                let in_cam = rotation * problem.points[p as usize] + DVec3::new(tx, ty, tz);
                let ray = -in_cam.truncate() / in_cam.z;
                let r2 = ray.length_squared();
                (f * (1.0 + r2 * (k1 + k2 * r2)) * ray - px).length_squared() / 2.0
            })
            .sum();
        assert!((cost / 8.509125e5 - 1.0).abs() < 1e-6, "{cost}");
    }

    #[test]
    fn wrong_files_are_refused() {
        let dangling = "1 1 1\n0 1 2 3\n0 0 0 0 0 0 1 0 0\n0 0 0\n";
        assert!(matches!(parse(dangling.as_bytes()), Err((_, Problem::Dangling { what: "point", .. }))));
        assert!(matches!(parse(b"99999999999 1 1\n"), Err((_, Problem::Truncated { .. }))));
        assert!(matches!(parse(b"1 1 1\n0 0 nan 3\n0 0 0 0 0 0 1 0 0\n0 0 0\n"), Err((_, Problem::NotFinite(_)))));
        assert!(matches!(parse(b"BZh9"), Err((_, Problem::WrongKind { .. }))));
    }

    proptest! {
        #[test]
        fn arbitrary_text_never_panics(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
            let _ = parse(&bytes);
        }

        #[test]
        fn arbitrary_numbers_never_panic(text in "[0-9]{1,2} [0-9]{1,2} [0-9]{1,3}\n([-0-9.e]{1,5}[ \n]){0,60}") {
            let _ = parse(text.as_bytes());
        }
    }
}
