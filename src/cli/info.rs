//! `dsl info`: what a report of a fault should say of the program and the machine.

use serde_json::json;

use super::args::InfoArgs;
use super::out;
use crate::memory;
use crate::render::accel;

pub fn run(args: &InfoArgs) -> u8 {
    let [version, build, system] = program();
    let (processor, instructions) = (processor(), accel::instructions());
    let (threads, limit, machine) = (rayon::current_num_threads(), memory::limit(), memory::machine());
    if args.common.json {
        let object = json!({
            "version": version, "build": build, "system": system, "processor": processor, "instructions": instructions,
            "threads": threads, "memory": machine, "memory_limit": limit,
        });
        out::line(&object.to_string());
        return 0;
    }
    let size = |bytes: Option<u64>| bytes.map_or_else(|| "unknown".to_owned(), memory::size_text);
    let rows = [
        ("version", format!("dscene {version}, {build} build")),
        ("system", system),
        ("processor", processor.unwrap_or_else(|| "unknown".to_owned())),
        ("ray tracing by", instructions.to_owned()),
        ("threads", threads.to_string()),
        ("memory", format!("{}, of which {} may be taken", size(machine), memory::size_text(limit))),
    ];
    for (name, value) in rows {
        out::line(&format!("{name:<15} {value}"));
    }
    0
}

/// The version, how it was built, and for which system.
fn program() -> [String; 3] {
    let build = if cfg!(debug_assertions) { "debug" } else { "release" };
    let system = format!("{} {}", std::env::consts::OS, std::env::consts::ARCH);
    [env!("CARGO_PKG_VERSION").to_owned(), build.to_owned(), system]
}

/// What `--version` says: the version, and what this program can.
pub fn version(processes: Option<&str>) -> String {
    let processes = processes.map_or_else(|| "one".to_owned(), |by| format!("any number, by {by}"));
    let ([version, build, system], instructions) = (program(), accel::instructions());
    format!("{version}\nbuild:       {build}, {system}\nray tracing: {instructions}\nprocesses:   {processes}")
}

/// The processor's name, where the system tells it.
fn processor() -> Option<String> {
    let text = std::fs::read_to_string("/proc/cpuinfo").ok()?;
    let line = text.lines().find(|line| line.starts_with("model name"))?;
    Some(line.split_once(':')?.1.trim().to_owned())
}
