//! Contacts: emitters and receivers that share a corner or cross, so that light reaches the receiver from arbitrarily close by.

mod build;
pub mod table;
