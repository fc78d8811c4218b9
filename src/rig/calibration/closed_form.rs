//! Zhang's closed form: a homography a photograph, two equations each for the image of the absolute
//! conic, and the poses that follow.
//!
//! With `H = K [r1 r2 t]` and `B = K⁻ᵀ K⁻¹`, the columns `h1`, `h2` obey
//!
//! ```text
//! h1ᵀ B h2 = 0,   h1ᵀ B h1 = h2ᵀ B h2                                      (Zhang 2000, Eq. 3–4)
//! ```
//!
//! Without skew `B` has five entries up to scale; distortion is left to the iteration that follows.

use glam::{DAffine3, DMat3, DVec2, DVec3};
use nalgebra::{Matrix3, SMatrix, SVector};

use super::{BoardView, Corner};

/// A lens without distortion, and a pose a photograph.
pub(super) struct Start {
    /// fx, fy, cx, cy, pixels.
    pub(super) intrinsics: [f64; 4],
    /// Board to camera.
    pub(super) poses: Vec<DAffine3>,
}

/// Where the iteration begins; `size` is the image's, pixels.
pub(super) fn initial(size: DVec2, views: &[BoardView]) -> Start {
    // Coordinates of order one about the image's centre keep the equations' columns alike.
    let (centre, scale) = (0.5 * size, 0.5 * size.max_element());
    let homographies: Vec<Matrix3<f64>> = views
        .iter()
        .map(|view| {
            let corners: Vec<Corner> = view
                .corners
                .iter()
                .map(|corner| Corner {
                    pixel: (corner.pixel - centre) / scale,
                    ..*corner
                })
                .collect();
            homography(&corners)
        })
        .collect();
    // Noise may leave no real K, or one whose centre is far outside; then the centre is the image's, and at
    // last the focal length an ordinary one. The iteration, and the errors it predicts, have the last word.
    let [fx, fy, cx, cy] = conic(&homographies)
        .or_else(|| focal_lengths(&homographies))
        .unwrap_or([2.0, 2.0, 0.0, 0.0]);
    let poses = homographies
        .iter()
        .map(|h| pose(h, [fx, fy, cx, cy]))
        .collect();
    Start {
        intrinsics: [
            fx * scale,
            fy * scale,
            cx * scale + centre.x,
            cy * scale + centre.y,
        ],
        poses,
    }
}

/// The homography from the board's plane to the image: direct linear transform on points of zero mean and
/// unit spread (Hartley 1997).
fn homography(corners: &[Corner]) -> Matrix3<f64> {
    let (board, board_normal) = normalised(corners.iter().map(|c| c.board));
    let (image, image_normal) = normalised(corners.iter().map(|c| c.pixel));
    let mut normal_matrix = SMatrix::<f64, 9, 9>::zeros();
    for (b, m) in board.iter().zip(&image) {
        let (x, y) = (b.x, b.y);
        let rows = [
            [x, y, 1.0, 0.0, 0.0, 0.0, -m.x * x, -m.x * y, -m.x],
            [0.0, 0.0, 0.0, x, y, 1.0, -m.y * x, -m.y * y, -m.y],
        ];
        for row in rows {
            let row = SVector::<f64, 9>::from(row);
            normal_matrix += row * row.transpose();
        }
    }
    let h = least_eigenvector(normal_matrix);
    let h = Matrix3::from_row_slice(h.as_slice());
    let back = image_normal.try_inverse().unwrap_or_default();
    let h = back * h * board_normal;
    h / h.norm()
}

/// Points moved to zero mean and unit spread, and the matrix that does so.
fn normalised(points: impl Iterator<Item = DVec2> + Clone) -> (Vec<DVec2>, Matrix3<f64>) {
    let count = points.clone().count() as f64;
    let mean = points.clone().sum::<DVec2>() / count;
    let spread = (points
        .clone()
        .map(|p| (p - mean).length_squared())
        .sum::<f64>()
        / count)
        .sqrt();
    let moved = points.map(|p| (p - mean) / spread).collect();
    let s = 1.0 / spread;
    let matrix = Matrix3::new(s, 0.0, -s * mean.x, 0.0, s, -s * mean.y, 0.0, 0.0, 1.0);
    (moved, matrix)
}

/// The eigenvector of the smallest eigenvalue.
fn least_eigenvector<const N: usize>(matrix: SMatrix<f64, N, N>) -> SVector<f64, N>
where
    nalgebra::Const<N>: nalgebra::DimSub<nalgebra::U1>,
    nalgebra::DefaultAllocator:
        nalgebra::allocator::Allocator<nalgebra::DimDiff<nalgebra::Const<N>, nalgebra::U1>>,
{
    // Overflow would keep the decomposition from ever ending; any vector is as good then.
    let finite = matrix.iter().all(|x| x.is_finite());
    let eigen = matrix
        .map(|x| if finite { x } else { 0.0 })
        .symmetric_eigen();
    eigen.eigenvectors.column(eigen.eigenvalues.imin()).into()
}

/// `[fx, fy, cx, cy]` from all five entries of B (Zhang 2000, Appendix B, without skew).
fn conic(homographies: &[Matrix3<f64>]) -> Option<[f64; 4]> {
    let mut normal_matrix = SMatrix::<f64, 5, 5>::zeros();
    for h in homographies {
        let v = |i: usize, j: usize| {
            let (a, b) = (h.column(i), h.column(j));
            SVector::from([
                a[0] * b[0],
                a[1] * b[1],
                a[0] * b[2] + a[2] * b[0],
                a[1] * b[2] + a[2] * b[1],
                a[2] * b[2],
            ])
        };
        for row in [v(0, 1), v(0, 0) - v(1, 1)] {
            normal_matrix += row * row.transpose();
        }
    }
    let [b11, b22, b13, b23, b33] = least_eigenvector(normal_matrix).into();
    let (cx, cy) = (-b13 / b11, -b23 / b22);
    let lambda = b33 + b13 * cx + b23 * cy;
    let (fx2, fy2) = (lambda / b11, lambda / b22);
    let sound = fx2 > 0.01 && fy2 > 0.01 && fx2 < 1e6 && fy2 < 1e6 && cx.abs().max(cy.abs()) < 0.5;
    sound.then(|| [fx2.sqrt(), fy2.sqrt(), cx, cy])
}

/// As [`conic`], the principal point in the image's centre.
fn focal_lengths(homographies: &[Matrix3<f64>]) -> Option<[f64; 4]> {
    let mut matrix = SMatrix::<f64, 2, 2>::zeros();
    let mut right = SVector::<f64, 2>::zeros();
    for h in homographies {
        let (a, b) = (h.column(0), h.column(1));
        let orthogonal = a.component_mul(&b);
        let equally_long = a.component_mul(&a) - b.component_mul(&b);
        for equation in [orthogonal, equally_long] {
            let row = SVector::from([equation[0], equation[1]]);
            matrix += row * row.transpose();
            right -= row * equation[2];
        }
    }
    let inverse_squares = matrix.cholesky()?.solve(&right);
    let focal = |x: f64| (x > 1e-6 && x < 100.0).then(|| 1.0 / x.sqrt());
    Some([
        focal(inverse_squares[0])?,
        focal(inverse_squares[1])?,
        0.0,
        0.0,
    ])
}

/// The board's pose from its homography (Zhang 2000, §3.1 and Appendix C), in front of the camera.
fn pose(h: &Matrix3<f64>, [fx, fy, cx, cy]: [f64; 4]) -> DAffine3 {
    let ray = |i: usize| {
        let w = h[(2, i)];
        DVec3::new((h[(0, i)] - cx * w) / fx, (h[(1, i)] - cy * w) / fy, w)
    };
    let (r1, r2, t) = (ray(0), ray(1), ray(2));
    let sign = if t.z < 0.0 { -1.0 } else { 1.0 };
    let scale = sign * 2.0 / (r1.length() + r2.length());
    let (r1, r2) = (r1 * scale, r2 * scale);
    DAffine3 {
        matrix3: nearest_rotation(DMat3::from_cols(r1, r2, r1.cross(r2))),
        translation: t * scale,
    }
}

/// The rotation nearest to a matrix in Frobenius' norm; none is nearest to what is not finite, where the
/// decomposition would never end.
pub(in crate::rig) fn nearest_rotation(matrix: DMat3) -> DMat3 {
    if !matrix.is_finite() {
        return DMat3::IDENTITY;
    }
    let svd = Matrix3::from_column_slice(&matrix.to_cols_array()).svd(true, true);
    let (Some(mut u), Some(v_t)) = (svd.u, svd.v_t) else {
        return DMat3::IDENTITY;
    };
    if (u * v_t).determinant() < 0.0 {
        u.column_mut(2).neg_mut();
    }
    let rotation = u * v_t;
    let mut columns = [0.0; 9];
    columns.copy_from_slice(rotation.as_slice());
    DMat3::from_cols_array(&columns)
}
