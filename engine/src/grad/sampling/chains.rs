//! Chains of edges: joins contours and creases end to end, as straight as possible.

use glam::Vec3;

use crate::math::position_key;

/// An edge of a chain, by its index, and whether the chain runs from its end to its start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Link {
    pub edge: usize,
    pub reversed: bool,
}

/// Orders edges with these ends into chains. Open chains come first, each beginning at the end whose edge has the lower index; then
/// closed loops. Where more than two edges meet, the pairs that turn least are joined.
pub fn chains(edges: &[[Vec3; 2]]) -> Vec<Link> {
    // A half is an end of an edge: twice the edge's index, plus one for its end point.
    let mut ends: Vec<([u32; 3], u32)> = (0..2 * edges.len() as u32)
        .map(|half| (position_key(edges[half as usize / 2][half as usize % 2]), half))
        .collect();
    ends.sort_unstable();
    let mut next = vec![NONE; ends.len()];
    for meeting in ends.chunk_by(|a, b| a.0 == b.0) {
        pair(edges, meeting, &mut next);
    }
    let mut order = Vec::with_capacity(edges.len());
    let mut done = vec![false; edges.len()];
    let mut follow = |start: u32, order: &mut Vec<Link>| {
        // Goes from a half to the other end of its edge, and on to the half that is joined there.
        let mut half = start;
        while half != NONE && !std::mem::replace(&mut done[half as usize / 2], true) {
            order.push(Link { edge: half as usize / 2, reversed: half % 2 == 1 });
            half = next[half as usize ^ 1];
        }
    };
    // Open chains first, and then loops.
    for half in 0..next.len() as u32 {
        if next[half as usize] == NONE {
            follow(half, &mut order);
        }
    }
    for half in 0..next.len() as u32 {
        follow(half, &mut order);
    }
    order
}

const NONE: u32 = u32::MAX;

/// Joins the ends at one position in pairs, the straightest first.
fn pair(edges: &[[Vec3; 2]], meeting: &[([u32; 3], u32)], next: &mut [u32]) {
    /// If more ends than this meet, they are joined in their order.
    const MANY: usize = 16;
    let away = |half: u32| {
        let [start, end] = edges[half as usize / 2];
        let along = (end - start).normalize_or_zero();
        if half.is_multiple_of(2) { along } else { -along }
    };
    let mut join = |a: u32, b: u32| (next[a as usize], next[b as usize]) = (b, a);
    match meeting {
        [(_, a), (_, b)] => join(*a, *b),
        _ if meeting.len() > MANY => meeting.chunks_exact(2).for_each(|two| join(two[0].1, two[1].1)),
        _ => {
            let mut rest: Vec<(u32, Vec3)> = meeting.iter().map(|&(_, half)| (half, away(half))).collect();
            while rest.len() > 1 {
                let pairs = (0..rest.len()).flat_map(|i| (i + 1..rest.len()).map(move |j| (i, j)));
                let turn = |&(i, j): &(usize, usize)| rest[i].1.dot(rest[j].1);
                let Some((i, j)) = pairs.min_by(|a, b| turn(a).total_cmp(&turn(b))) else { break };
                join(rest[i].0, rest[j].0);
                rest.swap_remove(j);
                rest.swap_remove(i);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const P: fn(f32, f32) -> Vec3 = |x, y| Vec3::new(x, y, 0.0);

    fn numbers(order: &[Link]) -> Vec<(usize, bool)> {
        order.iter().map(|l| (l.edge, l.reversed)).collect()
    }

    #[test]
    fn a_scattered_contour_is_one_chain() {
        let edges = [[P(2., 0.), P(3., 0.)], [P(1., 0.), P(0., 0.)], [P(1., 0.), P(2., 0.)]];
        assert_eq!(numbers(&chains(&edges)), [(0, true), (2, true), (1, false)]);
    }

    #[test]
    fn loops_are_walked_round_once() {
        let corners = [P(0., 0.), P(1., 0.), P(1., 1.), P(0., 1.)];
        let edges =
            [[corners[0], corners[1]], [corners[2], corners[3]], [corners[1], corners[2]], [corners[0], corners[3]]];
        assert_eq!(numbers(&chains(&edges)), [(0, false), (2, false), (1, false), (3, true)]);
    }

    #[test]
    fn lines_that_cross_go_straight_on() {
        let o = P(0., 0.);
        let edges = [[P(-1., 0.), o], [P(0., -1.), o], [o, P(0., 1.)], [o, P(1., 0.)]];
        assert_eq!(numbers(&chains(&edges)), [(0, false), (3, false), (1, false), (2, false)]);
    }

    #[test]
    fn every_edge_comes_once() {
        // A star of many, two loops that share a corner, an edge alone.
        let mut edges: Vec<[Vec3; 2]> = (0..21).map(|i| [P(0., 0.), P(i as f32, 1.)]).collect();
        for o in [P(5., 5.), P(6., 5.)] {
            let corners = [o, o + P(0., 1.), o + P(1., 0.)];
            edges.extend((0..3).map(|i| [corners[i], corners[(i + 1) % 3]]));
        }
        edges.push([P(50., 0.), P(51., 0.)]);
        let mut seen: Vec<usize> = chains(&edges).iter().map(|l| l.edge).collect();
        seen.sort_unstable();
        assert_eq!(seen, (0..edges.len()).collect::<Vec<usize>>());
    }
}
