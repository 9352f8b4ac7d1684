//! Blends: two materials in one.

use crate::render::Blend;

use super::scene::no_layer;
use super::value::{Input, MaterialValue};
use super::{NativeError, Result};

const METAL: &str = "`conductor(roughness: 0, …)` has a lobe, however narrow";
const PANE: &str = "`thin_dielectric(roughness: 0, …)` can be blended: what it lets through is a lobe, however narrow";

/// Two materials in one: `weight` is the share of the second. An error is at the place of the material that cannot be blended.
pub fn blended(first: &MaterialValue, second: &MaterialValue, weight: Input) -> Result<MaterialValue> {
    for (i, material) in [first, second].into_iter().enumerate() {
        let (message, help) = if material.blend.is_some() {
            ("this material is a blend already, and a blend has two materials".to_owned(), None)
        } else if !material.kind.may_be_blended() {
            let message = format!("{}, which cannot be blended", no_layer(&material.kind));
            (message, Some(if material.kind.is_clear() { PANE } else { METAL }))
        } else if material.opacity.is_some() {
            ("this material has a mask".to_owned(), Some("give the blend the mask: `mask(blend(…), opacity: …)`"))
        } else if material.normals.is_some() {
            let help = "give the blend the normal map: `normal_map(blend(…), normals: …)`";
            ("this material has a normal map".to_owned(), Some(help))
        } else if material.one_sided != first.one_sided {
            ("one of both materials is one-sided".to_owned(), Some("all of a blend is: `one_sided(blend(…))`"))
        } else {
            continue;
        };
        let error = NativeError::at(i, message);
        return Err(match help {
            Some(help) => error.help(help),
            None => error,
        });
    }
    let MaterialValue { kind, grain, sheen, coat, .. } = second.clone();
    let blend = Some(Blend { kind, grain, sheen, coat, weight });
    Ok(MaterialValue { blend, ..first.clone() })
}
