//! Directions, frames, rigid transforms and spherical maps.

mod cube;
mod frame;
mod octahedral;
mod ray;
mod spherical;
mod turn;

pub use cube::{CubeGrid, CubePlace, CubeStencil, lagrange};
pub use frame::{Frame, Local};
pub use octahedral::{direction_from_octahedral, octahedral_from_direction, octahedral_neighbour};
pub use ray::{Ray, offset_origin};
pub use spherical::{direction_from_latlong, latlong_from_direction};
pub use turn::{Similarity, Turn};
