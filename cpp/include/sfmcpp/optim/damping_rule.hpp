// How λ follows success and failure.
#pragma once

#include "sfmcpp/linear/normal_equations.hpp"

namespace sfmcpp::optim {

class DampingRule {
 public:
  virtual ~DampingRule() = default;
  virtual void start(const linear::NormalEquations& normal) = 0;  // before the first step
  virtual void accepted(double gain_ratio) = 0;
  virtual void rejected() = 0;
  virtual linear::Damping damping() const = 0;
};

// Hartley & Zisserman: D = diag(JᵀJ), λ ÷ 10 on success, × 10 on failure (thesis eq. 2.45, with λ for
// the λ² of eq. 2.44).
class HartleyRule final : public DampingRule {
 public:
  explicit HartleyRule(double initial) : lambda_(initial) {}
  void start(const linear::NormalEquations&) override {}
  void accepted(double gain_ratio) override;
  void rejected() override;
  linear::Damping damping() const override { return {lambda_, linear::DampingMatrix::kDiagonal}; }

 private:
  double lambda_;
};

// Nielsen: D = I, λ₀ = τ max diag(JᵀJ); on success λ · max(1/3, 1 − (2ρ − 1)³), on failure λ · ν, ν · 2.
class NielsenRule final : public DampingRule {
 public:
  explicit NielsenRule(double tau) : tau_(tau) {}
  void start(const linear::NormalEquations& normal) override { lambda_ = tau_ * normal.max_diagonal(); }
  void accepted(double gain_ratio) override;
  void rejected() override;
  linear::Damping damping() const override { return {lambda_, linear::DampingMatrix::kIdentity}; }

 private:
  double tau_;
  double lambda_ = 0.0;
  double growth_ = 2.0;
};

}  // namespace sfmcpp::optim
