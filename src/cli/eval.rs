//! `dsl eval`

use serde_json::json;

use super::args::EvalArgs;
use super::{EXIT_WRONG, Terminal, load, out};
use crate::check::types::Ty;
use crate::eval;
use crate::session::clock::Stopwatch;
use crate::session::run::tell_warnings;
use crate::session::{World, world};

pub fn run(args: &EvalArgs) -> u8 {
    let mut terminal = Terminal::new(&args.common);
    let Some(mut loaded) = load(&args.file, &args.common, &mut terminal) else {
        return EXIT_WRONG;
    };
    let Some(expr) = loaded.expression(&args.expr, "EXPR", &mut terminal) else {
        return EXIT_WRONG;
    };
    let watch = Stopwatch::start();
    let result = world::listening(|| loaded.engine.eval(&expr));
    let seconds = watch.elapsed().wall;
    tell_warnings(&mut loaded.engine, &mut terminal);
    match result {
        Ok(value) => {
            let slope = eval::unit_of_slope(loaded.engine.program(), &expr);
            if args.common.json {
                let value = eval::to_json(&value);
                let mut object = json!({"value": value, "type": expr.ty.to_string(), "seconds": seconds});
                let is_of_angles = |ty: &Ty| matches!(ty, Ty::Estimate(of) if eval::is_angle(of));
                if eval::is_angle(&expr.ty) || is_of_angles(&expr.ty) {
                    object["unit"] = json!("rad");
                } else if !slope.is_empty() {
                    object["unit"] = json!("1/rad");
                }
                out::line(&object.to_string());
            } else {
                out::line(&(eval::show(&value, &expr.ty) + slope));
            }
            0
        }
        Err(diagnostic) if diagnostic.code == eval::INTERRUPTED => super::render::interrupted(&mut terminal),
        Err(diagnostic) => {
            terminal.diagnostic(&diagnostic, &loaded.engine.program().sources.clone());
            EXIT_WRONG
        }
    }
}
