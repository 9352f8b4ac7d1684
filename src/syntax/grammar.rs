//! The parser that pest makes of `grammar/dscene.pest`.

#![allow(missing_docs)]

use pest_derive::Parser;

#[derive(Parser)]
#[grammar = "../grammar/dscene.pest"]
pub struct Grammar;
