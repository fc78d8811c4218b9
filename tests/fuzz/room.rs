//! How much memory the kinds of files may take.

use super::Room;

/// Meshes and text: a count of a billion vertices needs two hundred times as much.
pub(crate) const FLAT: Room = Room {
    flat: 1 << 26,
    per_byte: 0,
};
/// PNG: 4096 samples of one byte, each of which becomes three floats.
pub(crate) const PICTURE: Room = Room {
    per_byte: 1 << 16,
    ..FLAT
};
/// The same, and what the tiff crate (0.11) takes for the values of a tag before it can be told a limit.
pub(crate) const TAGGED: Room = Room {
    flat: 0x1400_0000,
    ..PICTURE
};
/// EXR and Radiance HDR: 65536 bytes, of which the two of a grey half become four floats.
pub(crate) const PACKED: Room = Room {
    per_byte: 1 << 19,
    ..FLAT
};

/// Two of them at once.
pub(crate) const TWO_PACKED: Room = Room {
    per_byte: 2 << 19,
    ..FLAT
};
