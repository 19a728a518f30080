//! Which blocks meet at which eliminated point, in both orders.

use super::layout::BlockLayout;

/// A participant of a block: one block at one point. Participants are numbered point by point.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Member {
    /// The participant.
    pub participant: u32,
    /// End of its point's range of participants.
    pub end: u32,
    /// Its point.
    pub point: u32,
}

/// Which blocks meet at which point.
#[derive(Clone, Debug)]
pub struct Incidence {
    point_start: Vec<u32>,
    block: Vec<u32>,
    /// Per block, the range of `order` that lists its participants.
    order_start: Vec<u32>,
    /// Participants of each block in ascending order.
    order: Vec<Member>,
}

impl Incidence {
    /// From the distinct blocks of every point in ascending order: those of point `p` are
    /// `block[point_start[p]..point_start[p + 1]]`. `None` where a list is not strictly ascending, names a block that
    /// does not exist or has no unknowns, or the offsets do not fit.
    pub fn new(layout: &BlockLayout, point_start: Vec<u32>, block: Vec<u32>) -> Option<Self> {
        if point_start.first() != Some(&0) || point_start.last().copied() != u32::try_from(block.len()).ok() {
            return None;
        }
        let blocks = layout.num_blocks();
        let mut order_start = vec![0u32; blocks + 1];
        for pair in point_start.windows(2) {
            let list = block.get(pair[0] as usize..pair[1] as usize)?;
            if !list.windows(2).all(|w| w[0] < w[1]) {
                return None;
            }
            for &b in list {
                if b as usize >= blocks || layout.size(b as usize) == 0 {
                    return None;
                }
                order_start[b as usize + 1] += 1;
            }
        }
        for b in 0..blocks {
            order_start[b + 1] += order_start[b];
        }
        let mut next = order_start.clone();
        let mut order = vec![Member::default(); block.len()];
        for (point, pair) in point_start.windows(2).enumerate() {
            for q in pair[0]..pair[1] {
                let slot = &mut next[block[q as usize] as usize];
                order[*slot as usize] = Member { participant: q, end: pair[1], point: point as u32 };
                *slot += 1;
            }
        }
        Some(Self { point_start, block, order_start, order })
    }

    /// No points at all.
    pub fn empty(layout: &BlockLayout) -> Self {
        let order_start = vec![0; layout.num_blocks() + 1];
        Self { point_start: vec![0], block: Vec::new(), order_start, order: Vec::new() }
    }

    /// Number of points.
    pub fn num_points(&self) -> usize {
        self.point_start.len() - 1
    }

    /// Number of participants.
    pub fn num_participants(&self) -> usize {
        self.block.len()
    }

    /// The participants of a point.
    pub fn participants(&self, point: usize) -> std::ops::Range<usize> {
        self.point_start[point] as usize..self.point_start[point + 1] as usize
    }

    /// The block of a participant.
    pub fn block(&self, participant: usize) -> usize {
        self.block[participant] as usize
    }

    /// The blocks of consecutive participants.
    pub(super) fn block_range(&self, participants: std::ops::Range<usize>) -> &[u32] {
        &self.block[participants]
    }

    /// The blocks of a point, ascending.
    pub fn blocks(&self, point: usize) -> &[u32] {
        &self.block[self.participants(point)]
    }

    /// The participants of a block, ascending.
    pub fn of_block(&self, block: usize) -> &[Member] {
        &self.order[self.order_start[block] as usize..self.order_start[block + 1] as usize]
    }

    /// `Σ k(k+1)/2` over points with `k` participants: the block products one assembly takes.
    pub fn num_pairs(&self) -> usize {
        self.point_start
            .windows(2)
            .map(|w| {
                let k = (w[1] - w[0]) as usize;
                k * (k + 1) / 2
            })
            .sum()
    }

    pub(super) fn all_blocks(&self) -> &[u32] {
        &self.block
    }
}
