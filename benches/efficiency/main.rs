//! How good derivatives are for their price, on the scenes of `scenes.rs`: value, bias against finite differences or a
//! closed form, standard deviation, CPU seconds, 1 / (variance × CPU seconds).
//!
//! ```text
//! cargo bench --bench efficiency                            the table, 16 seeds
//!     -- --scene TEXT --seeds N --precise --quick --no-fd --json
//!     -- --remember                                          gradients learn from one another, as the steps of an optimisation do
//! cargo bench --bench efficiency -- --fd [--budget SECONDS] [--precise]  renews docs/efficiency_references.json
//!     -- --fd --step H                                       only prints differences of another step
//! cargo bench --bench efficiency -- --export FOLDER          the scenes, for other renderers
//! cargo bench --bench efficiency -- --table OURS PEER        two outputs of --json as one page
//! cargo bench --bench efficiency -- --turns OURS PEER        outputs of --json --scene forward, made in turns
//! cargo bench --bench efficiency -- --scaling                time and memory as meshes and textures grow
//! ```

#[path = "../../tests/common/mod.rs"]
mod common;

mod closed;
mod export;
mod measure;
mod report;
mod scaling;
mod scenes;

use std::path::PathBuf;
use std::process::ExitCode;

use measure::References;
use scenes::Case;

#[derive(Default)]
struct Args {
    scene: Option<String>,
    seeds: Option<u64>,
    quick: bool,
    /// More seeds where noise asks for them; a quarter of the error for references.
    precise: bool,
    remember: bool,
    no_fd: bool,
    json: bool,
    fd: bool,
    budget: Option<f64>,
    step: Option<f32>,
    export: Option<PathBuf>,
    table: Option<(PathBuf, PathBuf)>,
    turns: Option<(PathBuf, PathBuf)>,
    scaling: bool,
    scaling_row: Option<String>,
}

fn parse() -> Result<Args, String> {
    let mut args = Args::default();
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let mut next = || words.next().ok_or(format!("{word} needs a value"));
        match word.as_str() {
            "--scene" => args.scene = Some(next()?),
            "--seeds" => args.seeds = Some(next()?.parse().map_err(|e| format!("--seeds: {e}"))?),
            "--budget" => args.budget = Some(next()?.parse().map_err(|e| format!("--budget: {e}"))?),
            "--step" => args.step = Some(next()?.parse().map_err(|e| format!("--step: {e}"))?),
            "--export" => args.export = Some(next()?.into()),
            "--table" => args.table = Some((next()?.into(), next()?.into())),
            "--turns" => args.turns = Some((next()?.into(), next()?.into())),
            "--scaling-row" => args.scaling_row = Some(next()?),
            "--precise" => args.precise = true,
            "--quick" => args.quick = true,
            "--remember" => args.remember = true,
            "--no-fd" => args.no_fd = true,
            "--json" => args.json = true,
            "--fd" => args.fd = true,
            "--scaling" => args.scaling = true,
            // What cargo passes to every bench.
            "--bench" => {}
            _ => return Err(format!("unknown argument {word}; see the head of benches/efficiency/main.rs")),
        }
    }
    if args.step.is_some() && !args.fd {
        return Err("--step goes with --fd".into());
    }
    if args.seeds.is_some_and(|n| n < 2) {
        return Err("--seeds must be at least 2".into());
    }
    Ok(args)
}

fn main() -> ExitCode {
    match parse().and_then(|args| run(&args).map_err(|e| e.to_string())) {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("{message}");
            ExitCode::FAILURE
        }
    }
}

fn run(args: &Args) -> std::io::Result<()> {
    if let Some(row) = &args.scaling_row {
        return scaling::row(row);
    }
    if args.scaling {
        return scaling::table(args.quick, args.scene.as_deref());
    }
    if let Some((ours, peer)) = &args.table {
        return report::side_by_side(ours, peer);
    }
    if let Some((ours, peer)) = &args.turns {
        return report::turns(ours, peer);
    }
    let cases = scenes::all();
    let chosen = |case: &&Case| args.scene.as_ref().is_none_or(|text| case.id().contains(text.as_str()));
    let cases: Vec<&Case> = cases.iter().filter(chosen).collect();
    let mut references = if args.no_fd { References::new() } else { measure::read_references()? };
    if args.fd {
        for case in cases.iter().filter(|case| case.exact.is_none()) {
            let reference = measure::reference(case, args);
            println!("{:60} {:12.5e} ± {:.2e}  {}", case.id(), reference.value, reference.error, reference.how);
            if args.step.is_none() {
                references.insert(case.id(), reference);
                measure::write_references(&references)?;
            }
        }
        return Ok(());
    }
    if let Some(folder) = &args.export {
        return export::export(&cases, folder, &references);
    }
    let seeds = args.seeds.unwrap_or(if args.quick { 4 } else { 16 });
    if !args.json {
        println!("{}", report::HEADER);
    }
    for case in cases {
        let row = measure::row(case, seeds, args, &references);
        if args.json { println!("{}", serde_json::to_string(&row)?) } else { println!("{}", report::line(&row)) }
    }
    if args.scene.as_deref().is_none_or(|text| text.contains("forward")) {
        for name in measure::FORWARD {
            let forward = measure::forward(name, if args.quick { 2 } else { 8 });
            if args.json {
                println!("{}", serde_json::json!({"forward": forward, "threads": rayon::current_num_threads()}));
            } else {
                println!("forward, {name}, 4 bounces: {:.2e} samples a CPU second", forward.samples_per_cpu_second);
            }
        }
    }
    Ok(())
}
