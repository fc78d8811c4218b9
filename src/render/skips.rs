//! What a frame need not do, and may be told to do all the same.
//!
//! None of these changes the expected image; `background`, `proven-open`, `zero-lobes` and `explored`
//! do not change a bit of it. They can be switched off one by one so that a test can say so and a
//! bench what each saves.

/// Work that can be left undone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Skip {
    /// Pixels that no triangle projects onto are not sampled.
    Background,
    /// Above a plane that the whole mesh lies below, tables know all the light and no ray is needed.
    ProvenOpen,
    /// Where little of the pixel is left to find, only some of the paths look for it.
    Negligible,
    /// The lobe is not weighed where rho_s is zero, the table not looked up where rho_d is.
    ZeroLobes,
    /// What blocks a patch of the surface is kept for other pixels and frames.
    Explored,
    /// Pixels all of whose corners see open surface, where tables leave no noise, get few paths.
    Smooth,
}

impl Skip {
    /// All of them, with the names that users give.
    pub const ALL: [(Self, &str); 6] = [
        (Self::Background, "background"),
        (Self::ProvenOpen, "proven-open"),
        (Self::Negligible, "negligible"),
        (Self::ZeroLobes, "zero-lobes"),
        (Self::Explored, "explored"),
        (Self::Smooth, "smooth"),
    ];
}

/// The skips that are on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Skips(u8);

impl Skips {
    /// Every skip.
    pub const ALL: Self = Self(u8::MAX);

    /// All of these but one.
    #[must_use]
    pub fn without(self, skip: Skip) -> Self {
        Self(self.0 & !(1 << skip as u8))
    }

    /// Whether a skip is on.
    #[inline]
    pub fn has(self, skip: Skip) -> bool {
        self.0 & (1 << skip as u8) != 0
    }
}

impl std::fmt::Display for Skips {
    /// As the option that switches skips off; empty if none is.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for (skip, name) in Skip::ALL {
            if !self.has(skip) {
                write!(f, " --no-skip {name}")?;
            }
        }
        Ok(())
    }
}
