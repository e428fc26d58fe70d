; Lanes whose given numbers are finite, and whose residuals are within their tolerances, as bits.
; The first `plain` rows are numbers; of the `checks` rows behind them, each two are a residual and its tolerance.
declare <4 x double> @llvm.fabs.v4f64(<4 x double>)

define i64 @check_inputs(ptr %rows, i64 %plain, i64 %checks, i64 %p, i64 %q) nounwind {
entry:
  %all = add i64 %plain, %checks
  br label %test
test:
  %k = phi i64 [0, %entry], [%k.next, %row]
  %total = phi <4 x double> [<double 0x0000000000000000, double 0x0000000000000000, double 0x0000000000000000, double 0x0000000000000000>, %entry], [%total.next, %row]
  %more = icmp slt i64 %k, %all
  br i1 %more, label %row, label %pairs
row:
  %place = mul i64 %k, 4
  %at = getelementptr double, ptr %rows, i64 %place
  %value = load <4 x double>, ptr %at, align 8
  %none = fmul <4 x double> %value, <double 0x0000000000000000, double 0x0000000000000000, double 0x0000000000000000, double 0x0000000000000000>
  %total.next = fadd <4 x double> %total, %none
  %k.next = add i64 %k, 1
  br label %test
pairs:
  %finite = fcmp oeq <4 x double> %total, <double 0x0000000000000000, double 0x0000000000000000, double 0x0000000000000000, double 0x0000000000000000>
  br label %check
check:
  %m = phi i64 [%plain, %pairs], [%m.next, %pair]
  %good = phi <4 x i1> [%finite, %pairs], [%good.next, %pair]
  %another = icmp slt i64 %m, %all
  br i1 %another, label %pair, label %done
pair:
  %first = mul i64 %m, 4
  %rest.at = getelementptr double, ptr %rows, i64 %first
  %rest = load <4 x double>, ptr %rest.at, align 8
  %most.at = getelementptr double, ptr %rest.at, i64 4
  %most = load <4 x double>, ptr %most.at, align 8
  %size = call <4 x double> @llvm.fabs.v4f64(<4 x double> %rest)
  %holds = fcmp ole <4 x double> %size, %most
  %good.next = and <4 x i1> %good, %holds
  %m.next = add i64 %m, 2
  br label %check
done:
  %packed = bitcast <4 x i1> %good to i4
  %mask = zext i4 %packed to i64
  ret i64 %mask
}
