//! The same two queries answered by Intel Embree 4, for comparison in benches and tests.
//!
//! The library is loaded at run time from the path in the environment variable
//! `TURNLIGHT_EMBREE_LIB`; the Python package `embreex` ships one.

#![expect(unsafe_code, reason = "a C library")]

use std::ffi::{c_char, c_int, c_void};
use std::path::Path;

use glam::Vec3;
use libloading::{Library, Symbol};

use super::Hit;
use crate::geometry::Ray;

/// The environment variable that names the library file.
pub const LIBRARY_VARIABLE: &str = "TURNLIGHT_EMBREE_LIB";

/// Why Embree isn't available.
#[derive(Debug, thiserror::Error)]
pub enum EmbreeError {
    /// The environment variable is not set.
    #[error("{LIBRARY_VARIABLE} is not set; point it at libembree4.so")]
    NotConfigured,
    /// The file isn't a library, or lacks a function.
    #[error("{0}")]
    Library(#[from] libloading::Error),
    /// Embree reported an error code of its own.
    #[error("Embree failed with RTCError {0}")]
    Embree(c_int),
}

/// Embree's single-ray traversal: with watertight intersection, or faster and not watertight.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// `RTC_SCENE_FLAG_NONE`
    Fast,
    /// `RTC_SCENE_FLAG_ROBUST`
    Robust,
}

type Handle = *mut c_void;

/// RTCRayHit; the tail leaves room for instance identifiers, whose number depends on the build.
#[repr(C, align(16))]
struct RayHit {
    origin: [f32; 3],
    near: f32,
    direction: [f32; 3],
    time: f32,
    far: f32,
    mask: u32,
    id: u32,
    flags: u32,
    normal: [f32; 3],
    u: f32,
    v: f32,
    primitive: u32,
    geometry: u32,
    instances: [u32; 9],
}

impl RayHit {
    #[inline]
    fn new(ray: &Ray, t_max: f32) -> Self {
        Self {
            origin: ray.origin.to_array(),
            near: 0.0,
            direction: ray.direction.to_array(),
            time: 0.0,
            far: t_max,
            mask: u32::MAX,
            id: 0,
            flags: 0,
            normal: [0.0; 3],
            u: 0.0,
            v: 0.0,
            primitive: u32::MAX,
            geometry: u32::MAX,
            instances: [u32::MAX; 9],
        }
    }
}

type Release = unsafe extern "C" fn(Handle);
type Query = unsafe extern "C" fn(Handle, *mut RayHit, *mut c_void);

/// A mesh in an Embree scene.
pub struct Embree {
    scene: Handle,
    device: Handle,
    intersect: Query,
    occluded: Query,
    release_scene: Release,
    release_device: Release,
}

// SAFETY: Embree allows concurrent queries of a committed scene.
unsafe impl Send for Embree {}
// SAFETY: as above.
unsafe impl Sync for Embree {}

impl Embree {
    /// Loads the library and builds the scene with Embree's default quality.
    pub fn build(
        positions: &[Vec3],
        triangles: &[[u32; 3]],
        mode: Mode,
    ) -> Result<Self, EmbreeError> {
        let path = std::env::var_os(LIBRARY_VARIABLE).ok_or(EmbreeError::NotConfigured)?;
        // SAFETY: the names and signatures are those of embree4/rtcore*.h, the constants those of
        // its enumerations, and the buffers that Embree returns have the sizes asked for.
        unsafe { Self::load(Path::new(&path), positions, triangles, mode) }
    }

    unsafe fn load(
        path: &Path,
        positions: &[Vec3],
        triangles: &[[u32; 3]],
        mode: Mode,
    ) -> Result<Self, EmbreeError> {
        const TRIANGLES: c_int = 0;
        const INDEX_BUFFER: c_int = 0;
        const VERTEX_BUFFER: c_int = 1;
        const UINT3: c_int = 0x5003;
        const FLOAT3: c_int = 0x9003;
        const ROBUST: c_int = 1 << 2;

        // SAFETY: the contract of `build`.
        unsafe {
            let library = Library::new(path)?;
            let new_device: Symbol<unsafe extern "C" fn(*const c_char) -> Handle> =
                library.get(b"rtcNewDevice\0")?;
            let device_error: Symbol<unsafe extern "C" fn(Handle) -> c_int> =
                library.get(b"rtcGetDeviceError\0")?;
            let new_scene: Symbol<unsafe extern "C" fn(Handle) -> Handle> =
                library.get(b"rtcNewScene\0")?;
            let set_flags: Symbol<unsafe extern "C" fn(Handle, c_int)> =
                library.get(b"rtcSetSceneFlags\0")?;
            let new_geometry: Symbol<unsafe extern "C" fn(Handle, c_int) -> Handle> =
                library.get(b"rtcNewGeometry\0")?;
            let new_buffer: Symbol<
                unsafe extern "C" fn(Handle, c_int, u32, c_int, usize, usize) -> *mut c_void,
            > = library.get(b"rtcSetNewGeometryBuffer\0")?;
            let commit_geometry: Symbol<unsafe extern "C" fn(Handle)> =
                library.get(b"rtcCommitGeometry\0")?;
            let attach: Symbol<unsafe extern "C" fn(Handle, Handle) -> u32> =
                library.get(b"rtcAttachGeometry\0")?;
            let release_geometry: Symbol<unsafe extern "C" fn(Handle)> =
                library.get(b"rtcReleaseGeometry\0")?;
            let commit_scene: Symbol<unsafe extern "C" fn(Handle)> =
                library.get(b"rtcCommitScene\0")?;

            let intersect: Query = *library.get(b"rtcIntersect1\0")?;
            let occluded: Query = *library.get(b"rtcOccluded1\0")?;
            let release_scene: Release = *library.get(b"rtcReleaseScene\0")?;
            let release_device: Release = *library.get(b"rtcReleaseDevice\0")?;

            let device = new_device(std::ptr::null());
            if device.is_null() {
                return Err(EmbreeError::Embree(device_error(device)));
            }
            let scene = new_scene(device);
            set_flags(scene, if mode == Mode::Robust { ROBUST } else { 0 });
            let geometry = new_geometry(device, TRIANGLES);
            let vertices: *mut [f32; 3] =
                new_buffer(geometry, VERTEX_BUFFER, 0, FLOAT3, 12, positions.len()).cast();
            let indices: *mut [u32; 3] =
                new_buffer(geometry, INDEX_BUFFER, 0, UINT3, 12, triangles.len()).cast();
            if !vertices.is_null() && !indices.is_null() {
                for (i, position) in positions.iter().enumerate() {
                    *vertices.add(i) = position.to_array();
                }
                indices.copy_from_nonoverlapping(triangles.as_ptr(), triangles.len());
            }
            commit_geometry(geometry);
            attach(scene, geometry);
            release_geometry(geometry);
            commit_scene(scene);
            let error = device_error(device);

            // The library stays loaded for good: the threads with which it has built the scene
            // outlive the device, and would go on in memory that is no longer mapped.
            std::mem::forget(library);
            let embree = Self {
                scene,
                device,
                intersect,
                occluded,
                release_scene,
                release_device,
            };
            if error == 0 {
                Ok(embree)
            } else {
                Err(EmbreeError::Embree(error))
            }
        }
    }

    /// See [`super::Accel::closest_hit`].
    #[inline]
    pub fn closest_hit(&self, ray: &Ray, t_max: f32) -> Option<Hit> {
        let mut query = RayHit::new(ray, t_max);
        // SAFETY: the scene is committed and the query has Embree's layout and alignment.
        unsafe { (self.intersect)(self.scene, &raw mut query, std::ptr::null_mut()) };
        (query.geometry != u32::MAX).then_some(Hit {
            t: query.far,
            triangle: query.primitive,
            u: query.u,
            v: query.v,
        })
    }

    /// See [`super::Accel::occluded`].
    #[inline]
    pub fn occluded(&self, ray: &Ray, t_max: f32) -> bool {
        let mut query = RayHit::new(ray, t_max);
        // SAFETY: as in `closest_hit`; an occlusion query reads and writes the ray part only.
        unsafe { (self.occluded)(self.scene, &raw mut query, std::ptr::null_mut()) };
        query.far == f32::NEG_INFINITY
    }
}

impl Drop for Embree {
    fn drop(&mut self) {
        // SAFETY: both handles are alive, and no query can run any more.
        unsafe {
            (self.release_scene)(self.scene);
            (self.release_device)(self.device);
        }
    }
}
