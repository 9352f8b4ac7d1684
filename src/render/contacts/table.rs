//! Which pairs of triangles touch, of which one shines on the other.

use std::collections::{HashMap, HashSet};

use crate::render::accel::PrimId;

/// Receivers with the emitters that touch them. Between these emission is differentiated direction-fixed: material-fixed, as
/// elsewhere, the receiving point slides towards an emitting point that stays, and derivatives grow like 1/distance. Either
/// is right for any pair, as long as every estimator has the same list.
///
/// Emitters without an edge between them ([`crate::render::edges::EdgeTable::flat_emitters`]) are one: where what is differentiated one way bordered
/// on what is differentiated the other way, there would have to be one.
pub struct Contacts {
    /// The emitters by their patches.
    pub(super) pairs: HashSet<(PrimId, PrimId)>,
    pub(super) patches: HashMap<PrimId, PrimId>,
}

impl Contacts {
    pub fn is_empty(&self) -> bool {
        self.pairs.is_empty()
    }

    pub fn contains(&self, receiver: PrimId, emitter: PrimId) -> bool {
        self.pairs.contains(&(receiver, patch_of(&self.patches, emitter)))
    }

    /// Whether any emitter touches a receiver.
    pub fn touches(&self, receiver: PrimId, emitters: impl IntoIterator<Item = PrimId>) -> bool {
        !self.is_empty() && emitters.into_iter().any(|e| self.contains(receiver, e))
    }
}

pub(super) fn patch_of(patches: &HashMap<PrimId, PrimId>, prim: PrimId) -> PrimId {
    patches.get(&prim).copied().unwrap_or(prim)
}
