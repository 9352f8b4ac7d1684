//! The arguments of a call of a native, by the names of its parameters.

use super::infer::Typed;
use super::modules::Signature;
use super::signature::Const;
use super::types::Ty;

#[derive(Clone, Copy)]
pub struct Arguments<'a> {
    pub signature: &'a Signature,
    found: &'a [Option<Typed>],
}

impl<'a> Arguments<'a> {
    pub fn new(signature: &'a Signature, found: &'a [Option<Typed>]) -> Arguments<'a> {
        Arguments { signature, found }
    }

    fn index(&self, name: &str) -> Option<usize> {
        self.signature.params.iter().position(|p| p.name == name)
    }

    /// The argument with a name, if the call gives it.
    pub fn get(&self, name: &str) -> Option<&'a Typed> {
        self.at(self.index(name)?)
    }

    /// The argument of the parameter with an index, if the call gives it.
    pub fn at(&self, index: usize) -> Option<&'a Typed> {
        self.found.get(index)?.as_ref()
    }

    pub fn first(&self) -> Option<&'a Typed> {
        self.at(0)
    }

    /// All arguments that the call gives, in the order of the parameters.
    pub fn given(&self) -> impl Iterator<Item = &'a Typed> + use<'a> {
        self.found.iter().flatten()
    }

    pub fn ty(&self, name: &str) -> Option<&'a Ty> {
        self.get(name).map(|a| &a.expr.ty)
    }

    /// The value of an argument, if it is known before the program runs.
    pub fn value(&self, name: &str) -> Option<&'a Const> {
        self.get(name)?.value.as_ref()
    }

    pub fn number(&self, name: &str) -> Option<f64> {
        self.value(name)?.number()
    }

    pub fn count(&self, name: &str) -> Option<usize> {
        self.value(name)?.count()
    }

    /// A count that the call gives, or its default.
    pub fn count_or(&self, name: &str, default: usize) -> Option<usize> {
        if self.get(name).is_none() { Some(default) } else { self.count(name) }
    }

    pub fn word(&self, name: &str) -> Option<&'a str> {
        match self.value(name)? {
            Const::Str(word) => Some(word),
            _ => None,
        }
    }
}
