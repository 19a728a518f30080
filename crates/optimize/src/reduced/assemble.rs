//! Subtracting the eliminated points from the reduced matrix.

use super::incidence::Incidence;
use super::kernel::{Vectorized, dispatch, subtract_product};
use super::matrix::BlockMatrix;
use super::pattern::BlockPattern;
use crate::parallel;

/// Participants whose factors are held at once: with 6 unknowns a block, 6 MB, which stays near the cores.
const CHUNK_PARTICIPANTS: usize = 32 * 1024;
/// Beyond this many passes over the matrix its own traffic would cost more than the factors' does.
const MAX_CHUNKS: usize = 24;
/// Points whose factors one thread fills at a time.
const FILL_POINTS: usize = 256;
/// No slot for this column in the current row.
const ABSENT: u32 = u32::MAX;

impl BlockMatrix {
    /// `A −= Σ_points E Eᵀ`. `fill(point, factors)` writes, for each participant of the point in order, `Eᵀ`: 3 rows of
    /// [`super::BlockLayout::factor_stride`] scalars, of which the first `size` count (the buffer comes zeroed, padding
    /// must stay zero). Only blocks in the pattern are formed.
    pub fn subtract_points(&mut self, incidence: &Incidence, fill: impl Fn(usize, &mut [f64]) + Sync + Send) {
        let pattern = self.pattern().clone();
        let participant_len = 3 * pattern.layout().factor_stride();
        if participant_len == 0 {
            return;
        }
        let chunk_len = CHUNK_PARTICIPANTS.max(incidence.num_participants() / MAX_CHUNKS);
        let mut factors = Vec::new();
        let mut first = 0;
        while first < incidence.num_points() {
            let start = incidence.participants(first).start;
            let mut last = first + 1;
            while last < incidence.num_points() && incidence.participants(last).end - start <= chunk_len {
                last += 1;
            }
            let end = incidence.participants(last - 1).end;
            factors.clear();
            factors.resize((end - start) * participant_len, 0.0);
            fill_factors(incidence, first..last, &mut factors, participant_len, &fill);
            subtract_chunk(&pattern, &mut self.values, incidence, start..end, &factors);
            first = last;
        }
    }
}

fn fill_factors(
    incidence: &Incidence,
    points: std::ops::Range<usize>,
    factors: &mut [f64],
    participant_len: usize,
    fill: &(impl Fn(usize, &mut [f64]) + Sync + Send),
) {
    let start = incidence.participants(points.start).start;
    let groups: Vec<usize> = points.clone().step_by(FILL_POINTS).chain([points.end]).collect();
    let offset = |point: usize| match point == points.end {
        true => factors.len(),
        false => (incidence.participants(point).start - start) * participant_len,
    };
    let offsets: Vec<usize> = groups.iter().map(|&p| offset(p)).collect();
    let mut pieces = parallel::split_mut(factors, &offsets);
    parallel::for_each_mut(&mut pieces, |g, piece| {
        let base = incidence.participants(groups[g]).start;
        for point in groups[g]..groups[g + 1] {
            let range = incidence.participants(point);
            fill(point, &mut piece[(range.start - base) * participant_len..(range.end - base) * participant_len]);
        }
    });
}

fn subtract_chunk(
    pattern: &BlockPattern,
    values: &mut [f64],
    incidence: &Incidence,
    participants: std::ops::Range<usize>,
    factors: &[f64],
) {
    let blocks = pattern.layout().num_blocks();
    let offsets: Vec<usize> =
        (0..blocks).map(|i| pattern.value_offset(pattern.row(i).start)).chain([pattern.num_values()]).collect();
    let mut rows = parallel::split_mut(values, &offsets);
    parallel::for_each_mut(&mut rows, |i, values| {
        let members = incidence.of_block(i);
        let begin = members.partition_point(|m| (m.0 as usize) < participants.start);
        let end = members.partition_point(|m| (m.0 as usize) < participants.end);
        if begin < end {
            dispatch(Row {
                pattern,
                incidence,
                members: &members[begin..end],
                base: participants.start,
                factors,
                i,
                values,
            });
        }
    });
}

struct Row<'a> {
    pattern: &'a BlockPattern,
    incidence: &'a Incidence,
    members: &'a [(u32, u32)],
    base: usize,
    factors: &'a [f64],
    i: usize,
    values: &'a mut [f64],
}

impl Vectorized for Row<'_> {
    #[inline(always)]
    fn run<const FMA: bool>(self) {
        let layout = self.pattern.layout();
        let (rows, pitch) = (layout.size(self.i), layout.factor_stride());
        let slots = self.pattern.row(self.i);
        let row_start = self.pattern.value_offset(slots.start);
        if slots.len() == 1 {
            let stride = layout.stride(self.i);
            for &(q, _) in self.members {
                let e = &self.factors[(q as usize - self.base) * 3 * pitch..][..3 * pitch];
                subtract_product::<FMA>(rows, stride, e, e, pitch, self.values);
            }
            return;
        }
        // Offset and stride of each block column in this row.
        let mut place = vec![(ABSENT, 0u32); layout.num_blocks() - self.i];
        for slot in slots {
            let j = self.pattern.column(slot);
            place[j - self.i] = ((self.pattern.value_offset(slot) - row_start) as u32, layout.stride(j) as u32);
        }
        for &(q, end) in self.members {
            let q = q as usize;
            let e = &self.factors[(q - self.base) * 3 * pitch..][..3 * pitch];
            for other in q..end as usize {
                let (at, stride) = place[self.incidence.block(other) - self.i];
                if at == ABSENT {
                    continue;
                }
                let f = &self.factors[(other - self.base) * 3 * pitch..][..3 * pitch];
                subtract_product::<FMA>(rows, stride as usize, e, f, pitch, &mut self.values[at as usize..]);
            }
        }
    }
}
