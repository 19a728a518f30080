//! Pairs of images: which rows belong to which pair, and whether their match indices can be trusted.

use std::collections::BTreeMap;

use epipole_scene::{Pair, ViewImage};
use rusqlite::Row;

use super::images::Keypoints;
use super::open::Source;
use super::schema::{Table, blob, integer};
use super::{MAX_NUM_IMAGES, ReadOptions, blob as blobs, verified};
use crate::error::{FormatError, Problem, Warnings};

/// The images of a pair as the row orders them; the matches' columns are in the order of the id.
#[derive(Clone, Copy, Debug)]
pub(super) struct PairKey {
    /// Dense index of the image with the smaller id, and of the other.
    pub(super) images: [usize; 2],
    /// Whether the row was stored for (larger, smaller) and has to be turned round.
    pub(super) swapped: bool,
}

/// What the rows of pairs are checked against.
pub(super) struct PairContext<'a> {
    pub(super) images: &'a [ViewImage],
    pub(super) keypoints: &'a Keypoints,
}

impl PairContext<'_> {
    /// Decodes `pair_id = 2147483647 · id1 + id2`.
    pub(super) fn key(&self, pair_id: i64) -> Result<PairKey, Problem> {
        let out_of_range = || Problem::OutOfRange {
            what: "pair_id".into(),
            found: pair_id.to_string(),
            expected: "2147483647 * image_id1 + image_id2".into(),
        };
        let id = u64::try_from(pair_id).map_err(|_| out_of_range())?;
        let (id1, id2) = (id / MAX_NUM_IMAGES, id % MAX_NUM_IMAGES);
        if id1 == id2 {
            return Err(out_of_range());
        }
        let find = |id: u64| {
            let found = self.images.binary_search_by_key(&id, |i| u64::from(i.id));
            found.map_err(|_| Problem::Dangling { what: "image", id: id.to_string() })
        };
        let (a, b) = (find(id1)?, find(id2)?);
        Ok(PairKey { images: [a.min(b), a.max(b)], swapped: a > b })
    }

    /// A readable name of the row: the ids of its images.
    pub(super) fn name(&self, pair_id: i64) -> String {
        match u64::try_from(pair_id) {
            Ok(id) => format!("pair {pair_id} (images {} and {})", id / MAX_NUM_IMAGES, id % MAX_NUM_IMAGES),
            Err(_) => format!("pair {pair_id}"),
        }
    }

    /// The match list of a row, in the order of `key`: indices checked, matches of non-finite keypoints left out.
    pub(super) fn matches(&self, row: &Row<'_>, key: PairKey) -> Result<Vec<[u32; 2]>, Problem> {
        let rows = row_count(row)?;
        let mut list = blobs::index_pairs(blob(row, 2, "data")?, rows)?;
        if key.swapped {
            list.iter_mut().for_each(|m| m.swap(0, 1));
        }
        let images = key.images.map(|i| &self.images[i]);
        let count = images.map(|i| i.keypoints_px.len() as u64);
        for m in &list {
            for side in 0..2 {
                if u64::from(m[side]) >= count[side] {
                    return Err(Problem::OutOfRange {
                        what: format!("a match index of image {}", images[side].id),
                        found: m[side].to_string(),
                        expected: format!("below its {} keypoints", count[side]),
                    });
                }
            }
        }
        if key.images.iter().any(|&i| self.keypoints.has_non_finite[i]) {
            list.retain(|m| (0..2).all(|side| images[side].keypoints_px[m[side] as usize].is_finite()));
        }
        Ok(list)
    }

    fn is_usable(&self, key: PairKey) -> bool {
        key.images.iter().all(|&i| !self.keypoints.unusable[i])
    }
}

/// `rows`, the number of matches.
pub(super) fn row_count(row: &Row<'_>) -> Result<u64, Problem> {
    let rows = integer(row, 1, "rows")?;
    // More than this cannot be indexed, and sums of larger numbers would overflow.
    u32::try_from(rows).map(u64::from).map_err(|_| Problem::OutOfRange {
        what: "rows".into(),
        found: rows.to_string(),
        expected: format!("0 to {}", u32::MAX),
    })
}

/// Reads verified geometries and matches; pairs come sorted by (image1, image2).
pub(super) fn read(
    source: &Source,
    images: &[ViewImage],
    keypoints: &Keypoints,
    options: &ReadOptions,
    warnings: &mut Warnings,
) -> Result<Vec<Pair>, FormatError> {
    let context = PairContext { images, keypoints };
    let mut pairs: BTreeMap<[usize; 2], Pair> = BTreeMap::new();
    let verified = Table::probe(source, &["two_view_geometries", "inlier_matches"])?;
    let raw = Table::probe(source, &["matches"])?;
    if verified.is_none() && !(options.raw_matches && raw.is_some()) {
        let advice = "match the images and verify the matches (`colmap exhaustive_matcher`)";
        return Err(FormatError::invalid(source.table("two_view_geometries"), Problem::MissingTable, advice));
    }
    if let Some(table) = verified {
        for_each_pair(source, &table, &context, verified::COLUMNS, warnings, |row, key, place, warnings| {
            if pairs.contains_key(&key.images) {
                return Err(Problem::Duplicate { what: "pair", key: "of the same two images".into() });
            }
            pairs.insert(key.images, verified::pair(row, key, &context, place, warnings)?);
            Ok(())
        })?;
    }
    let Some(table) = raw else {
        if options.raw_matches {
            let consequence = "only verified matches are there; use them, or match the images again";
            warnings.push(source.table("matches"), Problem::MissingTable, consequence);
        }
        return Ok(pairs.into_values().collect());
    };
    // Without the list, only its length is asked for: SQLite then never touches the pages that hold it.
    let columns = if options.raw_matches { &["data"][..] } else { &[] };
    for_each_pair(source, &table, &context, columns, warnings, |row, key, _, _| {
        let (list, count) = if options.raw_matches {
            let list = context.matches(row, key)?;
            let count = list.len();
            (Some(list), count)
        } else {
            (None, row_count(row)? as usize)
        };
        if let Some(pair) = pairs.get_mut(&key.images) {
            (pair.matches, pair.num_matches) = (list, count);
        } else if list.is_some() {
            let pair = Pair { matches: list, num_matches: count, ..unverified(key) };
            pairs.insert(key.images, pair);
        }
        Ok(())
    })?;
    Ok(pairs.into_values().collect())
}

/// A pair of which nothing is known yet.
pub(super) fn unverified(key: PairKey) -> Pair {
    Pair::unverified(key.images[0], key.images[1])
}

/// Calls `each` for every row whose pair can be used and turns its problems into warnings.
fn for_each_pair(
    source: &Source,
    table: &Table,
    context: &PairContext<'_>,
    columns: &[&'static str],
    warnings: &mut Warnings,
    mut each: impl FnMut(&Row<'_>, PairKey, crate::error::Location, &mut Warnings) -> Result<(), Problem>,
) -> Result<(), FormatError> {
    let mut of_unusable_images = 0usize;
    table.for_each(source, &["pair_id", "rows"], columns, |row| {
        let id = integer(row, 0, "pair_id");
        let name = id.as_ref().map_or("pair ?".to_owned(), |&id| context.name(id));
        let place = table.location(source).row(name);
        let result = id.and_then(|id| context.key(id)).and_then(|key| {
            if !context.is_usable(key) {
                of_unusable_images += 1;
                return Ok(());
            }
            each(row, key, place.clone(), warnings)
        });
        if let Err(problem) = result {
            warnings.push(place, problem, "the pair is left out; match its images again");
        }
        Ok(())
    })?;
    if of_unusable_images > 0 {
        let problem =
            Problem::Inconsistent(format!("{of_unusable_images} pairs have an image without readable keypoints"));
        warnings.push(table.location(source), problem, "they are left out");
    }
    Ok(())
}
