//! Ray queries against a mesh: closest hit and occlusion.
