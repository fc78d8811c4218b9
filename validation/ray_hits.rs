//! Hands turnlight's ray hits to `check_hits.py`.
//!
//! `ray_hits POSITIONS.npy TRIANGLES.npy RAYS.npy OUT.npy`: positions `[V, 3]` f32, triangles
//! `[T, 3]` int32 or uint32, rays `[N, 6]` f32 (origin, direction); the answer is `[N, 5]` f64:
//! hit (0 or 1), t, triangle, occluded (0 or 1), u.

use std::fs::File;
use std::io::{BufReader, BufWriter};
use std::path::Path;

use anyhow::{Context, Result, bail};
use glam::Vec3;
use npyz::{NpyFile, WriterBuilder};
use rayon::prelude::*;
use turnlight::accel::Accel;
use turnlight::geometry::Ray;

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [positions, triangles, rays, out] = arguments.as_slice() else {
        bail!("usage: ray_hits POSITIONS.npy TRIANGLES.npy RAYS.npy OUT.npy");
    };
    let positions: Vec<Vec3> = rows(&floats(positions)?)
        .map(|row: [f32; 3]| row.into())
        .collect();
    let triangles: Vec<[u32; 3]> = rows(&indices(triangles)?).collect();
    let rays = floats(rays)?;

    let accel = Accel::build(&positions, &triangles);
    let answers: Vec<[f64; 5]> = (rays.par_chunks_exact(6))
        .map(|row| {
            let ray = Ray {
                origin: Vec3::from_slice(row),
                direction: Vec3::from_slice(&row[3..]),
            };
            let occluded = f64::from(u8::from(accel.occluded(&ray, f32::INFINITY)));
            match accel.closest_hit(&ray, f32::INFINITY) {
                Some(hit) => [
                    1.0,
                    hit.t.into(),
                    hit.triangle.into(),
                    occluded,
                    hit.u.into(),
                ],
                None => [0.0, f64::INFINITY, -1.0, occluded, 0.0],
            }
        })
        .collect();

    let file = BufWriter::new(File::create(out).with_context(|| out.clone())?);
    let mut writer = npyz::WriteOptions::new()
        .default_dtype()
        .shape(&[answers.len() as u64, 5])
        .writer(file)
        .begin_nd()?;
    writer.extend(answers.into_iter().flatten())?;
    writer.finish()?;
    Ok(())
}

fn open(path: impl AsRef<Path>) -> Result<NpyFile<BufReader<File>>> {
    let path = path.as_ref();
    let name = || path.display().to_string();
    NpyFile::new(BufReader::new(File::open(path).with_context(name)?)).with_context(name)
}

fn floats(path: &str) -> Result<Vec<f32>> {
    open(path)?
        .into_vec()
        .with_context(|| format!("{path}: expected f32"))
}

fn indices(path: &str) -> Result<Vec<u32>> {
    if let Ok(unsigned) = open(path)?.into_vec::<u32>() {
        return Ok(unsigned);
    }
    let signed = open(path)?.into_vec::<i32>();
    let signed = signed.with_context(|| format!("{path}: expected int32 or uint32"))?;
    Ok(signed
        .into_iter()
        .map(u32::try_from)
        .collect::<Result<_, _>>()?)
}

fn rows<T: Copy, const N: usize>(values: &[T]) -> impl Iterator<Item = [T; N]> {
    values
        .chunks_exact(N)
        .map(|row| std::array::from_fn(|i| row[i]))
}
