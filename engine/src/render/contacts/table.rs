//! The table of contacts: pairs of triangles that touch and of which one shines on the other.

use std::collections::{HashMap, HashSet};

use crate::render::accel::PrimId;

/// Receivers and the emitters that touch them. For these pairs the emission is differentiated with its direction fixed. Elsewhere it is
/// differentiated with the emitting point fixed to its surface; for a pair that touches, the two points may be arbitrarily close, and
/// derivatives would grow like 1/distance. Either parametrisation is right for any pair, as long as all estimators use the same one.
///
/// Coplanar emitters that have no edge between them ([`crate::render::edges::EdgeTable::flat_emitters`]) form a patch, and a receiver
/// touches all emitters of a patch or none. If the parametrisation changed within a patch, there would have to be an edge with a boundary
/// term at that place.
pub struct Contacts {
    /// Receivers with the patches that touch them.
    pub(super) pairs: HashSet<(PrimId, PrimId)>,
    /// The patch of an emitter, named by the least primitive in it. Emitters that are not here are a patch of their own.
    pub(super) patches: HashMap<PrimId, PrimId>,
}

impl Contacts {
    pub fn is_empty(&self) -> bool {
        self.pairs.is_empty()
    }

    pub fn contains(&self, receiver: PrimId, emitter: PrimId) -> bool {
        self.pairs.contains(&(receiver, patch_of(&self.patches, emitter)))
    }
}

pub(super) fn patch_of(patches: &HashMap<PrimId, PrimId>, prim: PrimId) -> PrimId {
    patches.get(&prim).copied().unwrap_or(prim)
}
