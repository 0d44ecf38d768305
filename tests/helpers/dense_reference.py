"""The same model in the plainest dense form: every feature, the precision of all weights, one inverse per
round.

An oracle for the tests and the yardstick of the benchmarks; it shares no code with the package.
"""

import numpy as np
import scipy.linalg
from scipy.special import expit


def dense_features(points_m, hinges_m, gamma_per_m2):
    return np.exp(-gamma_per_m2 * ((points_m[:, None, :] - hinges_m[None, :, :]) ** 2).sum(axis=-1))


def sigmoid(value):
    return expit(value)


def trusted(latent_mean, is_occupied, iteration):
    """The mean that enters xi: in the first round only where the label agrees with the prior's side of
    zero.
    """
    agrees = (latent_mean > 0) == np.asarray(is_occupied, dtype=bool)
    return latent_mean if iteration > 0 else np.where(agrees, latent_mean, 0.0)


class DenseReference:
    """P' = P + 2 Phi^T L Phi and P' mu' = P mu + Phi^T (y - 1/2 - 2 lambda b), xi^2 from the posterior, P
    kept fixed.
    """

    def __init__(self, hinges_m, *, gamma_per_m2, weight_variance, prevalence, n_iterations):
        self.hinges_m, self.gamma_per_m2, self.n_iterations = hinges_m, gamma_per_m2, n_iterations
        self.weight_variance, self.prevalence = weight_variance, prevalence
        self.precision = np.eye(len(hinges_m)) / weight_variance
        self.covariance = np.eye(len(hinges_m)) * weight_variance
        self.mean = np.zeros(len(hinges_m))

    def offset(self, Phi):
        prior_variance = self.weight_variance * (Phi**2).sum(axis=1)
        return np.log(self.prevalence / (1 - self.prevalence)) * np.sqrt(1 + np.pi / 8 * prior_variance)

    def update(self, points_m, is_occupied):
        Phi = dense_features(points_m, self.hinges_m, self.gamma_per_m2)
        offset = self.offset(Phi)
        covariance, mean = self.covariance, self.mean
        for iteration in range(self.n_iterations):
            variance = np.einsum("nj,nj->n", Phi @ covariance, Phi)
            xi = np.sqrt(variance + trusted(offset + Phi @ mean, is_occupied, iteration) ** 2)
            curvature = (sigmoid(xi) - 0.5) / (2 * xi)
            precision = self.precision + 2 * Phi.T @ (curvature[:, None] * Phi)
            covariance = np.linalg.inv(precision)
            mean = covariance @ (
                self.precision @ self.mean + Phi.T @ (is_occupied - 0.5 - 2 * curvature * offset)
            )
        self.precision, self.covariance, self.mean = precision, covariance, mean
        return curvature

    def predict(self, points_m):
        Phi = dense_features(points_m, self.hinges_m, self.gamma_per_m2)
        variance = np.einsum("nj,nj->n", Phi @ self.covariance, Phi)
        mean = self.offset(Phi) + Phi @ self.mean
        return mean, variance, sigmoid(mean / np.sqrt(1 + np.pi / 8 * variance))


class DenseDiagonal(DenseReference):
    """The diagonal form, vectorised over all hinges."""

    def update(self, points_m, is_occupied):
        Phi = dense_features(points_m, self.hinges_m, self.gamma_per_m2)
        offset, squares = self.offset(Phi), Phi**2
        prior = np.diag(self.covariance) if self.covariance.ndim == 2 else self.covariance
        variance, mean = prior, self.mean
        for iteration in range(self.n_iterations):
            xi = np.sqrt(squares @ variance + trusted(offset + Phi @ mean, is_occupied, iteration) ** 2)
            curvature = (sigmoid(xi) - 0.5) / (2 * xi)
            variance = 1 / (1 / prior + 2 * squares.T @ curvature)
            mean = variance * (self.mean / prior + Phi.T @ (is_occupied - 0.5 - 2 * curvature * offset))
        self.covariance, self.mean = variance, mean

    def predict(self, points_m):
        Phi = dense_features(points_m, self.hinges_m, self.gamma_per_m2)
        variance = Phi**2 @ (np.diag(self.covariance) if self.covariance.ndim == 2 else self.covariance)
        mean = self.offset(Phi) + Phi @ self.mean
        return mean, variance, sigmoid(mean / np.sqrt(1 + np.pi / 8 * variance))


class CholeskyReference(DenseReference):
    """The same by Cholesky factors in place of inverses: the tidy dense form that benchmarks compare with."""

    def update(self, points_m, is_occupied):
        Phi = dense_features(points_m, self.hinges_m, self.gamma_per_m2)
        offset, mean = self.offset(Phi), self.mean
        factor = scipy.linalg.cholesky(self.precision, lower=True)
        for iteration in range(self.n_iterations):
            spread = scipy.linalg.solve_triangular(factor, Phi.T, lower=True)
            latent_mean = trusted(offset + Phi @ mean, is_occupied, iteration)
            xi = np.sqrt((spread**2).sum(axis=0) + latent_mean**2)
            curvature = (sigmoid(xi) - 0.5) / (2 * xi)
            scaled = np.sqrt(2 * curvature)[:, None] * Phi
            precision = self.precision + scaled.T @ scaled
            factor = scipy.linalg.cholesky(precision, lower=True)
            information = self.precision @ self.mean + Phi.T @ (is_occupied - 0.5 - 2 * curvature * offset)
            mean = scipy.linalg.cho_solve((factor, True), information)
        self.precision, self.factor, self.mean = precision, factor, mean
        return curvature

    def predict(self, points_m):
        Phi = dense_features(points_m, self.hinges_m, self.gamma_per_m2)
        variance = (scipy.linalg.solve_triangular(self.factor, Phi.T, lower=True) ** 2).sum(axis=0)
        mean = self.offset(Phi) + Phi @ self.mean
        return mean, variance, sigmoid(mean / np.sqrt(1 + np.pi / 8 * variance))
