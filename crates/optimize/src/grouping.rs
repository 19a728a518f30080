//! A stable counting sort: who belongs to which group, without comparing anything.

/// Offsets of the groups (one more than there are groups) and the positions in `group_of`, group by group, ascending within.
pub(crate) fn group(group_of: &[u32], groups: usize) -> (Vec<u32>, Vec<u32>) {
    let mut start = vec![0u32; groups + 1];
    for &g in group_of {
        start[g as usize + 1] += 1;
    }
    for g in 0..groups {
        start[g + 1] += start[g];
    }
    let mut next = start.clone();
    let mut members = vec![0u32; group_of.len()];
    for (position, &g) in group_of.iter().enumerate() {
        members[next[g as usize] as usize] = position as u32;
        next[g as usize] += 1;
    }
    (start, members)
}

#[cfg(test)]
mod tests {
    #[test]
    fn groups_keep_their_order_and_may_be_empty() {
        assert_eq!(super::group(&[2, 0, 2, 0], 4), (vec![0, 2, 2, 4, 4], vec![1, 3, 0, 2]));
    }
}
