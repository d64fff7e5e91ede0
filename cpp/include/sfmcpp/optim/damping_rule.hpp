// How λ follows success and failure.
#pragma once

#include "sfmcpp/linear/normal_equations.hpp"
#include "sfmcpp/optim/archive.hpp"

namespace sfmcpp::optim {

class DampingRule {
 public:
  virtual ~DampingRule() = default;
  virtual void start(const linear::NormalEquations& normal) = 0;  // before the first step
  virtual void accepted(double gain_ratio) = 0;
  virtual void rejected() = 0;
  virtual linear::Damping damping() const = 0;
  // Hands over what it has learned.
  virtual void keep(Archive& archive) = 0;
};

// λ₀ of the rule of Hartley (thesis §2.2.2.4), and of that of Nielsen, where the options leave them
// open. Problems of reconstructed photos take fewer steps from 1e-5 than from 1e-4, and fewer still
// from 1e-6, where synthetic scenes that start far away take more (docs/benchmarks.md).
inline constexpr double kHartleyStart = 1e-3;
inline constexpr double kNielsenStart = 1e-5;
// With a λ beyond this no unknown moves any more.
inline constexpr double kMaxLambda = 1e32;

// Hartley & Zisserman: D = diag(JᵀJ), λ ÷ 10 on success, × 10 on failure (thesis eq. 2.45, with λ
// for the λ² of eq. 2.44).
class HartleyRule final : public DampingRule {
 public:
  HartleyRule(double initial, linear::DampingMatrix matrix) : lambda_(initial), matrix_(matrix) {}
  void start(const linear::NormalEquations&) override {}
  void accepted(double gain_ratio) override;
  void rejected() override;
  linear::Damping damping() const override { return {lambda_, matrix_}; }
  void keep(Archive& archive) override { archive.keep(lambda_); }

 private:
  double lambda_;
  linear::DampingMatrix matrix_;
};

// Nielsen: on success λ · max(1/3, 1 − (2ρ − 1)³), on failure λ · ν, ν · 2. The thesis has D = I
// and λ₀ = τ max diag(JᵀJ), which depends on the units of the unknowns: focal lengths and
// distortion coefficients get the same damping. With D = diag(JᵀJ), the default, λ₀ = τ.
class NielsenRule final : public DampingRule {
 public:
  NielsenRule(double tau, linear::DampingMatrix matrix) : tau_(tau), matrix_(matrix) {}
  void start(const linear::NormalEquations& normal) override {
    lambda_ = matrix_ == linear::DampingMatrix::kIdentity ? tau_ * normal.max_diagonal() : tau_;
  }
  void accepted(double gain_ratio) override;
  void rejected() override;
  linear::Damping damping() const override { return {lambda_, matrix_}; }
  void keep(Archive& archive) override {
    archive.keep(lambda_);
    archive.keep(growth_);
  }

 private:
  double tau_;
  linear::DampingMatrix matrix_;
  double lambda_ = 0.0;
  double growth_ = 2.0;
};

}  // namespace sfmcpp::optim
