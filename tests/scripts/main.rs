//! Scripts from text to values: the language, its library, files that it reads, the command line and the REPL.

#[path = "../common/cpu.rs"]
mod cpu;
#[path = "../common/dice.rs"]
mod dice;
#[path = "../common/gltf.rs"]
mod gltf;
#[path = "../common/place.rs"]
mod place;
#[path = "../common/properties.rs"]
mod properties;
#[path = "../common/typed.rs"]
mod typed;

mod advice;
mod book;
mod checker;
mod cli;
mod commands;
mod costs;
mod data_files;
mod diagnostics;
mod editor_grammar;
mod expectations;
mod explain;
mod format;
mod formats;
mod fuzzed;
mod grad_server;
mod growth;
mod hostile_values;
mod image_files;
mod kept_inside;
mod known_values;
mod language;
mod library;
mod lints;
mod lsp;
mod materials;
mod mesh_files;
mod mutated_scripts;
mod natives;
mod other_languages;
mod records;
mod repl;
mod scene_files;
mod script_tests;
mod strangers;
mod terminal;
mod tidy;
mod told_of_files;
mod typed_programs;
