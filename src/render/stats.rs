//! What rendering cost, counted.

use std::ops::AddAssign;

use serde::Serialize;

/// Work done; sums over pixels and frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct RenderStats {
    /// Camera paths started.
    pub paths: u64,
    /// Those of them that only told how many were needed.
    pub pilot_paths: u64,
    /// Closest-hit queries, camera rays included.
    pub closest_rays: u64,
    /// Occlusion queries of paths; those that explore patches and find silhouettes are not counted.
    pub shadow_rays: u64,
    /// Surface interactions and directions above a plane that nothing of the mesh rises above: no ray
    /// was needed.
    pub proven_open: u64,
    /// Surface interactions shaded.
    pub bounces: u64,
    /// Those of them after which a path ended since little was left to find.
    pub negligible: u64,
    /// Those of them where a lobe was zero and not weighed or looked up.
    pub zero_lobes: u64,
    /// Patches of the surface of which rays told what blocks them.
    pub patches_explored: u64,
    /// Pixels that got few paths because they lie open as a whole.
    pub smooth_pixels: u64,
    /// Pixels skipped because no triangle projects onto them.
    pub background_pixels: u64,
}

impl AddAssign for RenderStats {
    fn add_assign(&mut self, other: Self) {
        self.paths += other.paths;
        self.pilot_paths += other.pilot_paths;
        self.closest_rays += other.closest_rays;
        self.shadow_rays += other.shadow_rays;
        self.proven_open += other.proven_open;
        self.bounces += other.bounces;
        self.negligible += other.negligible;
        self.zero_lobes += other.zero_lobes;
        self.patches_explored += other.patches_explored;
        self.smooth_pixels += other.smooth_pixels;
        self.background_pixels += other.background_pixels;
    }
}
