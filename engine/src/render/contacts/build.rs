//! Finds contacts: pairs of triangles that share a corner or cross, of which one is an emitter that shines on the other.

use std::collections::{BTreeSet, HashMap, HashSet};

use glam::Vec3;

use super::table::{Contacts, patch_of};
use crate::math::position_key;
use crate::render::accel::PrimId;
use crate::render::intersections::crossings;
use crate::render::material::MaterialKind;
use crate::render::world::Scene;

/// Corners that belong to more emitters than this are left out, so that building the table stays linear in the number of triangles.
const MAX_FAN: usize = 64;

impl Scene {
    /// The scene's contacts. They are found when first asked for, because rendering without derivatives needs none.
    pub(crate) fn contacts(&self) -> &Contacts {
        self.contact_table.get_or_init(|| Contacts::new(self))
    }

    /// Whether `receiver` touches `emitter` and can be lit by it (see [`Contacts`]).
    #[inline]
    pub(crate) fn touch(&self, receiver: PrimId, emitter: PrimId) -> bool {
        let contacts = self.contacts();
        !contacts.is_empty() && contacts.contains(receiver, emitter)
    }
}

impl Contacts {
    pub fn new(scene: &Scene) -> Contacts {
        let shape = |prim: PrimId| &scene.description.shapes[scene.prims[prim as usize].shape as usize];
        let all = 0..scene.prims.len() as PrimId;
        let mut emitters: HashMap<[u32; 3], Vec<PrimId>> = HashMap::new();
        for prim in all.clone().filter(|&p| shape(p).emission.is_some()) {
            for corner in scene.corners(prim) {
                emitters.entry(position_key(corner)).or_default().push(prim);
            }
        }
        let mut pairs = HashSet::new();
        if emitters.is_empty() {
            return Contacts { pairs, patches: HashMap::new() };
        }
        let plane = |prim: PrimId| {
            let [a, b, c] = scene.corners(prim);
            ((b - a).cross(c - a).normalize_or_zero(), a)
        };
        // Largest distance of a triangle's corners in front of (+) or behind (−) the plane of another.
        let reach = |prim: PrimId, (n, origin): (Vec3, Vec3), side: f32| {
            scene.corners(prim).into_iter().map(|p| side * n.dot(p - origin)).fold(0.0, f32::max)
        };
        let least = 1e-5 * scene.radius;
        let patches = patches(&scene.edges().flat_emitters);
        let mut consider = |receiver: PrimId, emitter: PrimId| {
            let (material, at, from) = (&shape(receiver).material, plane(receiver), plane(emitter));
            let Some(emission) = shape(emitter).emission.as_ref().filter(|_| emitter != receiver) else { return };
            if matches!(material.kind, MaterialKind::Black) || at.0 == Vec3::ZERO {
                return;
            }
            let lit = reach(receiver, from, 1.0) > least || (emission.two_sided && reach(receiver, from, -1.0) > least);
            let faces = reach(emitter, at, 1.0) > least || (!material.one_sided && reach(emitter, at, -1.0) > least);
            if lit && faces {
                pairs.insert((receiver, patch_of(&patches, emitter)));
            }
        };
        for receiver in all.clone() {
            for corner in scene.corners(receiver) {
                let fan = emitters.get(&position_key(corner)).filter(|fan| fan.len() <= MAX_FAN);
                fan.into_iter().flatten().for_each(|&emitter| consider(receiver, emitter));
            }
        }
        // Triangles that cross count together with all triangles that share a corner with them: near the end of a crossing these are as
        // close.
        let crossings: Vec<[[PrimId; 2]; 2]> =
            crossings(scene, |prim| shape(prim).emission.is_some()).into_iter().map(|c| c.prims).collect();
        let corners = |prims: [PrimId; 2]| prims.into_iter().flat_map(|prim| scene.corners(prim)).map(position_key);
        let mut fans: HashMap<[u32; 3], Vec<PrimId>> = HashMap::new();
        for corner in crossings.iter().flatten().flat_map(|prims| corners(*prims)) {
            fans.entry(corner).or_default();
        }
        let far = fans.is_empty();
        for prim in all.filter(|_| !far) {
            for corner in scene.corners(prim) {
                fans.entry(position_key(corner)).and_modify(|fan| fan.push(prim));
            }
        }
        for crossing in crossings {
            let around = |prims: [PrimId; 2]| {
                let fans = corners(prims).filter_map(|corner| fans.get(&corner)).filter(|fan| fan.len() <= MAX_FAN);
                prims.into_iter().chain(fans.flatten().copied()).collect::<BTreeSet<PrimId>>()
            };
            let [x, y] = crossing.map(around);
            for (&a, &b) in x.iter().flat_map(|a| y.iter().map(move |b| (a, b))) {
                consider(a, b);
                consider(b, a);
            }
        }
        Contacts { pairs, patches }
    }
}

/// Connected components of a graph of primitives (by union-find): maps each linked primitive to the least one of its component.
fn patches(links: &[[PrimId; 2]]) -> HashMap<PrimId, PrimId> {
    let mut patches: HashMap<PrimId, PrimId> = HashMap::new();
    fn least(patches: &mut HashMap<PrimId, PrimId>, prim: PrimId) -> PrimId {
        let mut root = prim;
        while let Some(&next) = patches.get(&root).filter(|&&next| next != root) {
            root = next;
        }
        let mut at = prim;
        while at != root {
            at = patches.insert(at, root).unwrap_or(root);
        }
        root
    }
    for link in links {
        let [a, b] = link.map(|prim| least(&mut patches, prim));
        patches.insert(a.max(b), a.min(b));
    }
    let linked: Vec<PrimId> = patches.keys().copied().collect();
    linked.into_iter().for_each(|prim| {
        least(&mut patches, prim);
    });
    patches
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patches_hold_together_by_way_of_others() {
        let patches = patches(&[[5, 4], [8, 7], [4, 3], [1, 8], [9, 2], [3, 5]]);
        let of = |prim: PrimId| patch_of(&patches, prim);
        assert_eq!([3, 4, 5].map(of), [3; 3]);
        assert_eq!([1, 7, 8].map(of), [1; 3]);
        assert_eq!([2, 9, 6].map(of), [2, 2, 6]);
    }
}
