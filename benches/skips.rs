//! What each skip of the renderer saves.
//!
//! `cargo bench --bench skips [-- SCENE...]` renders frames of shipped scenes with every skip, and with
//! each of them off, by turns in one run. The table gives how much longer a frame takes without it, as
//! the median over rounds of the ratio to the frame before it, and how often it was used.

#![expect(clippy::print_stdout, reason = "a bench prints its table")]
#![expect(clippy::unwrap_used, reason = "a bench may stop at once")]

use std::hint::black_box;
use std::time::Instant;

use turnlight::render::{FrameSettings, PathCount, RenderStats, Skip, Skips, Stage, render_frame};
use turnlight::scene::Scene;

const ROUNDS: usize = 7;

fn main() {
    let named: Vec<String> = std::env::args()
        .skip(1)
        .filter(|argument| !argument.starts_with("--"))
        .collect();
    let scenes = if named.is_empty() {
        ["sphere-plastic", "suzanne-plastic", "cup"]
            .map(|name| format!("scenes/{name}"))
            .to_vec()
    } else {
        named
    };
    println!(
        "{:28} {:12} {:>10} {:>9}   used",
        "scene", "without", "time", "+- %"
    );
    for scene in scenes {
        let (stage, _) = Stage::load(&Scene::load(&scene).unwrap()).unwrap();
        let frame = |skips: Skips| {
            let settings = FrameSettings {
                paths: PathCount::PerPixel(16),
                bounces: 3,
                seed: 1,
                skips,
            };
            let start = Instant::now();
            let frame = black_box(render_frame(&stage, 0, 0.0, &settings));
            (start.elapsed().as_secs_f64(), frame.stats)
        };
        // Explores what the frame needs: later frames find it.
        frame(Skips::ALL);
        for (skip, name) in Skip::ALL {
            let mut ratios: Vec<f64> = (0..ROUNDS)
                .map(|_| {
                    let (with, _) = frame(Skips::ALL);
                    frame(Skips::ALL.without(skip)).0 / with
                })
                .collect();
            ratios.sort_by(f64::total_cmp);
            let spread = 50.0 * (ratios[ROUNDS - 2] - ratios[1]);
            let (_, stats) = frame(Skips::ALL);
            println!(
                "{scene:28} {name:12} {:9.2}x {spread:9.1}   {}",
                ratios[ROUNDS / 2],
                used(skip, &stats)
            );
        }
    }
}

/// How often a frame made use of a skip.
fn used(skip: Skip, stats: &RenderStats) -> String {
    let share = |count: u64, of: u64, what: &str| {
        let percent = 100.0 * count as f64 / of.max(1) as f64;
        format!("{percent:.1} % of {what}")
    };
    match skip {
        Skip::Background => format!("{} pixels", stats.background_pixels),
        Skip::ProvenOpen => share(
            stats.proven_open,
            stats.proven_open + stats.closest_rays + stats.shadow_rays,
            "rays",
        ),
        Skip::Negligible => share(stats.negligible, stats.bounces, "surface interactions"),
        Skip::ZeroLobes => share(stats.zero_lobes, stats.bounces, "surface interactions"),
        Skip::Explored => "every patch of a later frame".to_owned(),
        Skip::Smooth => format!("most paths of {} pixels", stats.smooth_pixels),
    }
}
