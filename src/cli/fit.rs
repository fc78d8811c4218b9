//! `turnlight fit`: capture folder in, fit folder out.

use std::path::Path;
use std::time::Instant;

use glam::Vec3;
use serde::Serialize;

use super::arguments::{
    Common, EstimatorName, Fit, FitChoices, NdfName, PointsChoice, PoolName, SpecularName,
};
use super::failure::Failure;
use super::progress::{bar, note, write_stats, write_text};
use crate::accel::Accel;
use crate::brdf::Ndf;
use crate::estimate::{
    Estimate, Estimator, FitSettings, FitStats, FresnelModel, Pooling, Reason, SpecularColour,
    Status, TabulatedNdf, fit,
};
use crate::export::{FitFolder, NdfTable, PointTable};
use crate::image::{RgbImage, write_exr};
use crate::mesh::{ChartReport, Mesh, PointSet};
use crate::probe::SplitLight;
use crate::scene::Capture;
use crate::traces::{CollectSettings, TraceStats, collect};

/// What `fit.toml` records.
#[derive(Serialize)]
struct Record {
    turnlight: &'static str,
    capture: String,
    points: String,
    /// The charts made for a mesh without texture coordinates.
    charts: Option<ChartReport>,
    settings: FitSettings,
    timings: Timings,
    traces: TraceStats,
    fit: FitStats,
    status: StatusCounts,
    reason: ReasonCounts,
    /// How the light was found; absent where it was known.
    light: Option<LightRecord>,
    /// Fresnel terms of the converged points, the commonest first.
    fresnel: Vec<FresnelCount>,
}

/// How the light was found, `light.exr`.
#[derive(Serialize)]
struct LightRecord {
    /// Turns of light and materials.
    rounds: u32,
    /// How much the last one changed the light, root mean square relative to its own.
    change: f64,
}

/// Converged points of one Fresnel term.
#[derive(Serialize)]
struct FresnelCount {
    /// Index of refraction of a dielectric; absent where the term is Schlick's.
    eta: Option<f32>,
    points: usize,
}

impl FresnelCount {
    fn of(estimates: &[Estimate]) -> Vec<Self> {
        let mut counts: Vec<Self> = Vec::new();
        for estimate in estimates.iter().filter(|e| e.status == Status::Converged) {
            match counts.iter_mut().find(|count| count.eta == estimate.eta) {
                Some(count) => count.points += 1,
                None => counts.push(Self {
                    eta: estimate.eta,
                    points: 1,
                }),
            }
        }
        counts.sort_by_key(|count| std::cmp::Reverse(count.points));
        counts
    }
}

/// Seconds, wall clock.
#[derive(Clone, Copy, Serialize)]
struct Timings {
    load: f64,
    traces: f64,
    fit: f64,
    write: f64,
}

/// Points by how their search ended.
#[derive(Default, Serialize)]
struct StatusCounts {
    converged: usize,
    unidentifiable: usize,
    alpha_at_bound: usize,
    too_few_samples: usize,
    unseen: usize,
    saturated: usize,
}

/// Points whose roughness is not told, by what stands in the way.
#[derive(Default, Serialize)]
struct ReasonCounts {
    too_few_frames: usize,
    no_highlight: usize,
    collinear: usize,
    lobe_below_noise: usize,
    two_minima: usize,
    width_undetermined: usize,
}

impl ReasonCounts {
    fn of(estimates: &[Estimate]) -> Self {
        let mut counts = Self::default();
        for estimate in estimates {
            *match estimate.reason {
                Reason::None => continue,
                Reason::TooFewFrames => &mut counts.too_few_frames,
                Reason::NoHighlight => &mut counts.no_highlight,
                Reason::Collinear => &mut counts.collinear,
                Reason::LobeBelowNoise => &mut counts.lobe_below_noise,
                Reason::TwoMinima => &mut counts.two_minima,
                Reason::WidthUndetermined => &mut counts.width_undetermined,
            } += 1;
        }
        counts
    }
}

pub(super) fn run(arguments: &Fit, common: &Common) -> Result<(), Failure> {
    let capture = Capture::load(&arguments.capture)?;
    fit_capture(
        &capture,
        &arguments.capture,
        &arguments.out,
        &arguments.choices,
        common,
    )
}

/// Fits a capture and writes the fit folder.
pub(super) fn fit_capture(
    capture: &Capture,
    source: &Path,
    out: &Path,
    choices: &FitChoices,
    common: &Common,
) -> Result<(), Failure> {
    let settings = settings(choices);
    if settings.estimator != Estimator::Full && settings.fresnel == FresnelModel::Schlick {
        return Err(Failure::Input(anyhow::anyhow!(
            "--fresnel schlick: estimators by gradients know only a dielectric; \
             give --fresnel eta=1.3, or --estimator full"
        )));
    }

    if settings.estimator != Estimator::Full && settings.tabulated {
        return Err(Failure::Input(anyhow::anyhow!(
            "--ndf tabulated: estimators by gradients know only Beckmann and GGX; \
             give --ndf auto, or --estimator full"
        )));
    }

    // Load: mesh, light, and the points to fit.
    let started = Instant::now();
    let (mut mesh, mesh_report) = capture.object.load()?;
    let (environment, probe_report) = capture.probe.load()?;
    for (path, report) in [
        (&capture.object.mesh, mesh_report.to_string()),
        (&capture.probe.image, probe_report.to_string()),
    ] {
        if !report.trim().is_empty() {
            note(
                common,
                &format!("note: {}: {}", path.display(), report.trim()),
            );
        }
    }
    let mut charts = None;
    if let PointsChoice::Texels(resolution) = choices.points
        && mesh.uvs.is_none()
    {
        let (charted, report) = mesh
            .with_charts(resolution as u32)
            .map_err(|error| anyhow::anyhow!("{}: {error}", capture.object.mesh.display()))?;
        note(
            common,
            &format!(
                "note: {}: has no texture coordinates; {} charts were made, which cover {:.0} % of the \
                 map (mesh.ply of the fit has them){}",
                capture.object.mesh.display(),
                report.charts,
                100.0 * report.covered,
                match report.too_thin {
                    0 => String::new(),
                    n => format!("; nothing is fitted on {n} triangles too thin for them"),
                }
            ),
        );
        (mesh, charts) = (charted, Some(report));
    }
    let accel = Accel::build(&mesh.positions, &mesh.triangles);
    let light = SplitLight::new(&environment);
    let points = match choices.points {
        PointsChoice::Vertices => PointSet::vertices(&mesh),
        PointsChoice::Texels(resolution) => PointSet::texels(&mesh, resolution as u32)?,
    };
    if let Some(grid) = &points.grid
        && grid.overlaps + grid.outside > 0
    {
        note(
            common,
            &format!(
                "note: {}: {} texels are covered twice and belong to the first triangle; {} triangles \
                 reach outside the texture's square, where nothing is fitted; unwrap the mesh anew to \
                 measure all of it",
                capture.object.mesh.display(),
                grid.overlaps,
                grid.outside
            ),
        );
    }
    let load = started.elapsed().as_secs_f64();

    // Traces: what each point was seen to do.
    let started = Instant::now();
    let frames_bar = bar(common, "traces", capture.frames.len());
    let on_frame = |_| frames_bar.inc(1);
    let collect_settings = CollectSettings::default();
    let (traces, trace_stats) = collect(
        capture,
        &mesh,
        &accel,
        &points,
        &collect_settings,
        &on_frame,
    )?;
    frames_bar.finish_and_clear();
    if trace_stats.observed == 0 {
        return Err(Failure::Data(anyhow::anyhow!(
            "{}: no surface point is seen in any frame ({} pixels inside the masks: {} show an edge \
             or miss the mesh, {} are grazing, {} have no point near); check camera, turntable and masks",
            source.display(),
            trace_stats.pixels,
            trace_stats.edges,
            trace_stats.grazing,
            trace_stats.far
        )));
    }
    let trace_seconds = started.elapsed().as_secs_f64();

    // Fit.
    let started = Instant::now();
    let points_bar = bar(common, "fitting", traces.traces.len());
    let neighbours = points.neighbours(&mesh);
    let fitted = fit(&traces, &neighbours, &light, &accel, &settings, &|n| {
        points_bar.inc(n as u64)
    });
    let estimates = &fitted.estimates;
    points_bar.finish_and_clear();
    let fit_seconds = started.elapsed().as_secs_f64();

    // Write.
    let started = Instant::now();
    let table = table(&mesh, &points, estimates);
    let folder = FitFolder {
        capture,
        mesh: &mesh,
        table: &table,
        appearance: &fitted.appearance,
        grid: points.grid.as_ref(),
        eta: fitted.eta,
    };
    folder.write(out)?;
    if let Some(tabulated) = &fitted.tabulated {
        ndf_table(tabulated).write_npz(&out.join("ndf.npz"))?;
    }
    if let Some(light) = &fitted.light {
        let image = RgbImage::from_fn(light.width, light.height, |x, y| {
            light.radiance[y * light.width + x]
        });
        write_exr(&out.join("light.exr"), &image)?;
    }
    let mut status = StatusCounts::default();
    for estimate in estimates {
        *match estimate.status {
            Status::Converged => &mut status.converged,
            Status::Unidentifiable => &mut status.unidentifiable,
            Status::AlphaAtBound => &mut status.alpha_at_bound,
            Status::TooFewSamples => &mut status.too_few_samples,
            Status::Unseen => &mut status.unseen,
            Status::Saturated => &mut status.saturated,
        } += 1;
    }
    let summary = format!(
        "{}: {} points: {} converged, {} unidentifiable, {} at the bound of alpha, {} unseen; {:.1} s",
        out.display(),
        estimates.len(),
        status.converged,
        status.unidentifiable,
        status.alpha_at_bound,
        status.unseen,
        load + trace_seconds + fit_seconds
    );
    let timings = Timings {
        load,
        traces: trace_seconds,
        fit: fit_seconds,
        write: started.elapsed().as_secs_f64(),
    };
    let record = Record {
        turnlight: env!("CARGO_PKG_VERSION"),
        capture: absolute(source),
        points: match choices.points {
            PointsChoice::Vertices => "vertices".to_owned(),
            PointsChoice::Texels(n) => format!("texels={n}"),
        },
        charts,
        settings,
        timings,
        traces: trace_stats,
        fit: fitted.stats,
        reason: ReasonCounts::of(estimates),
        light: fitted.light.as_ref().map(|light| LightRecord {
            rounds: light.rounds,
            change: light.change,
        }),
        fresnel: FresnelCount::of(estimates),
        status,
    };
    let text = toml::to_string(&record).map_err(anyhow::Error::from)?;
    // Written last: a folder with fit.toml is complete.
    write_text(&out.join("fit.toml"), &text)?;
    note(common, &summary);
    write_stats(common, &record)
}

fn absolute(path: &Path) -> String {
    std::path::absolute(path)
        .unwrap_or_else(|_| path.to_owned())
        .display()
        .to_string()
}

fn settings(choices: &FitChoices) -> FitSettings {
    FitSettings {
        estimator: match choices.estimator {
            EstimatorName::Full => Estimator::Full,
            EstimatorName::Gradient => Estimator::Gradient,
            EstimatorName::UnknownLight => Estimator::UnknownLight,
        },
        ndf: match choices.ndf {
            NdfName::Auto | NdfName::Tabulated => None,
            NdfName::Beckmann => Some(Ndf::Beckmann),
            NdfName::Ggx => Some(Ndf::Ggx),
        },
        tabulated: choices.ndf == NdfName::Tabulated,
        specular: match choices.specular {
            SpecularName::Auto => SpecularColour::Auto,
            SpecularName::Neutral => SpecularColour::Neutral,
            SpecularName::Rgb => SpecularColour::Rgb,
        },
        pool: match choices.pool {
            PoolName::None => Pooling::None,
            PoolName::Smooth => Pooling::Smooth,
            PoolName::Material => Pooling::Material,
            PoolName::Object => Pooling::Object,
        },
        fresnel: choices.fresnel,
        light_nodes: choices.light_nodes as usize,
        interreflections: choices.interreflections,
        window: choices.window.to_radians(),
    }
}

/// Tabulated NDFs as the arrays of `ndf.npz`.
fn ndf_table(tabulated: &TabulatedNdf) -> NdfTable {
    let groups = || tabulated.groups.iter();
    let index = |group: &Option<u32>| group.map_or(-1, |m| m as i32);
    NdfTable {
        theta: tabulated.theta.clone(),
        density: groups().flat_map(|g| g.density.iter().copied()).collect(),
        sigma: groups().flat_map(|g| g.sigma.iter().copied()).collect(),
        integral: groups().map(|g| g.integral).collect(),
        alpha: groups().map(|g| g.alpha).collect(),
        ndf: groups().map(|g| g.ndf as i32).collect(),
        points: groups().map(|g| g.points as i32).collect(),
        group: tabulated.group.iter().map(index).collect(),
    }
}

/// The estimates as the arrays of `points.npz`.
fn table(mesh: &Mesh, set: &PointSet, estimates: &[Estimate]) -> PointTable {
    let points = &set.points;
    let vector =
        |f: &dyn Fn(&Estimate) -> Vec3| estimates.iter().map(|e| f(e).to_array()).collect();
    let number = |f: &dyn Fn(&Estimate) -> f32| estimates.iter().map(f).collect();
    let integer = |f: &dyn Fn(&Estimate) -> i32| estimates.iter().map(f).collect();
    PointTable {
        position: points
            .iter()
            .map(|p| mesh.to_object(p.position).as_vec3().to_array())
            .collect(),
        normal: points.iter().map(|p| p.normal.to_array()).collect(),
        rho_d: vector(&|e| e.rho_d),
        rho_s: vector(&|e| e.rho_s),
        f90: number(&|e| e.f90.unwrap_or(1.0)),
        fresnel: integer(&|e| i32::from(e.f90.is_some())),
        eta: number(&|e| e.eta.unwrap_or(f32::NAN)),
        alpha: number(&|e| e.alpha),
        ndf: integer(&|e| e.ndf as i32),
        sigma_rho_d: vector(&|e| e.sigma_rho_d),
        sigma_rho_s: number(&|e| e.sigma_rho_s),
        sigma_alpha: number(&|e| e.sigma_alpha),
        frames: integer(&|e| e.frames as i32),
        residual: number(&|e| e.residual),
        status: integer(&|e| e.status as i32),
        ndf_evidence: number(&|e| e.ndf_evidence),
        second_alpha: number(&|e| e.second_alpha),
        second_evidence: number(&|e| e.second_evidence),
        reason: integer(&|e| e.reason as i32),
        material: integer(&|e| e.material.map_or(-1, |m| m as i32)),
        borrowed: integer(&|e| i32::from(!e.lobe_is_known())),
        texel: match &set.grid {
            Some(grid) => grid.texels.iter().map(|&texel| texel as i32).collect(),
            None => vec![-1; points.len()],
        },
    }
}
