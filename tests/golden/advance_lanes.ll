; Time moved on in lanes whose step was accepted and passes no end; the other lanes are the bits returned.
declare <4 x double> @llvm.fabs.v4f64(<4 x double>)

define i64 @advance_lanes(ptr %clock, ptr %step, ptr %tally, ptr %settings, ptr %limits) nounwind {
  %now.at = getelementptr double, ptr %clock, i64 0
  %now = load <4 x double>, ptr %now.at, align 8
  %end.at = getelementptr double, ptr %clock, i64 4
  %end = load <4 x double>, ptr %end.at, align 8
  %next.at = getelementptr double, ptr %clock, i64 8
  %next = load <4 x double>, ptr %next.at, align 8
  %size.at = getelementptr double, ptr %step, i64 0
  %size = load <4 x double>, ptr %size.at, align 8
  %check.at = getelementptr double, ptr %step, i64 4
  %check = load <4 x double>, ptr %check.at, align 8
  %before.at = getelementptr double, ptr %tally, i64 0
  %before = load <4 x double>, ptr %before.at, align 8
  %reach.at = getelementptr double, ptr %settings, i64 0
  %reach = load <4 x double>, ptr %reach.at, align 8
  %direction.at = getelementptr double, ptr %settings, i64 4
  %direction = load <4 x double>, ptr %direction.at, align 8
  %largest.at = getelementptr double, ptr %limits, i64 0
  %largest.one = load double, ptr %largest.at, align 8
  %largest.first = insertelement <4 x double> undef, double %largest.one, i32 0
  %largest = shufflevector <4 x double> %largest.first, <4 x double> undef, <4 x i32> zeroinitializer
  %budget.at = getelementptr double, ptr %limits, i64 1
  %budget.one = load double, ptr %budget.at, align 8
  %budget.first = insertelement <4 x double> undef, double %budget.one, i32 0
  %budget = shufflevector <4 x double> %budget.first, <4 x double> undef, <4 x i32> zeroinitializer
  %to.go = fsub <4 x double> %end, %now
  %rest = call <4 x double> @llvm.fabs.v4f64(<4 x double> %to.go)
  %age = call <4 x double> @llvm.fabs.v4f64(<4 x double> %now)
  %late = fmul <4 x double> %age, <double 0x3CF0000000000000, double 0x3CF0000000000000, double 0x3CF0000000000000, double 0x3CF0000000000000>
  %short = fmul <4 x double> %rest, <double 0x39B4484BFEEBC2A0, double 0x39B4484BFEEBC2A0, double 0x39B4484BFEEBC2A0, double 0x39B4484BFEEBC2A0>
  %smallest = fadd <4 x double> %late, %short
  %attempts = fadd <4 x double> %before, <double 0x3FF0000000000000, double 0x3FF0000000000000, double 0x3FF0000000000000, double 0x3FF0000000000000>
  %move = fmul <4 x double> %direction, %size
  %then = fadd <4 x double> %now, %move
  %gap = fsub <4 x double> %next, %then
  %ahead = fmul <4 x double> %gap, %direction
  %left = fsub <4 x double> %end, %then
  %far = call <4 x double> @llvm.fabs.v4f64(<4 x double> %left)
  %nearer = fcmp olt <4 x double> %far, %largest
  %most = select <4 x i1> %nearer, <4 x double> %far, <4 x double> %largest
  %inside = fcmp olt <4 x double> %size, %rest
  %large = fcmp oge <4 x double> %size, %smallest
  %inside.large = and <4 x i1> %inside, %large
  %finite = fcmp oeq <4 x double> %check, <double 0x0000000000000000, double 0x0000000000000000, double 0x0000000000000000, double 0x0000000000000000>
  %accepted = and <4 x i1> %inside.large, %finite
  %allowed = fcmp olt <4 x double> %attempts, %budget
  %counted = and <4 x i1> %accepted, %allowed
  %unrecorded = fcmp ogt <4 x double> %ahead, <double 0x0000000000000000, double 0x0000000000000000, double 0x0000000000000000, double 0x0000000000000000>
  %moves = and <4 x i1> %counted, %unrecorded
  %now.new = select <4 x i1> %moves, <4 x double> %then, <4 x double> %now
  store <4 x double> %now.new, ptr %now.at, align 8
  %before.new = select <4 x i1> %moves, <4 x double> %attempts, <4 x double> %before
  store <4 x double> %before.new, ptr %before.at, align 8
  %reach.new = select <4 x i1> %moves, <4 x double> %most, <4 x double> %reach
  store <4 x double> %reach.new, ptr %reach.at, align 8
  %packed = bitcast <4 x i1> %moves to i4
  %others = xor i4 %packed, -1
  %mask = zext i4 %others to i64
  ret i64 %mask
}
