declare double @sin(double)
declare double @cos(double)
declare double @tan(double)
declare double @asin(double)
declare double @acos(double)
declare double @atan(double)
declare double @exp(double)
declare double @log(double)
declare double @sinh(double)
declare double @cosh(double)
declare double @tanh(double)
declare double @atan2(double, double)
declare double @pow(double, double)
declare <2 x double> @llvm.fabs.v2f64(<2 x double>)
declare <2 x double> @llvm.sqrt.v2f64(<2 x double>)
declare <2 x double> @llvm.floor.v2f64(<2 x double>)
declare <2 x double> @llvm.fma.v2f64(<2 x double>, <2 x double>, <2 x double>)

define internal {<2 x double>, <2 x double>} @sincos2(<2 x double> %x) alwaysinline nounwind {
entry:
  %size = call <2 x double> @llvm.fabs.v2f64(<2 x double> %x)
  %large = fcmp ugt <2 x double> %size, <double 0x412E848000000000, double 0x412E848000000000>
  %bits = bitcast <2 x i1> %large to i2
  %any = icmp ne i2 %bits, 0
  %shifted = call <2 x double> @llvm.fma.v2f64(<2 x double> %x, <2 x double> <double 0x3FE45F306DC9C883, double 0x3FE45F306DC9C883>, <2 x double> <double 0x4338000000000000, double 0x4338000000000000>)
  %k = fsub <2 x double> %shifted, <double 0x4338000000000000, double 0x4338000000000000>
  %q = bitcast <2 x double> %shifted to <2 x i64>
  %minus = fneg <2 x double> %k
  %r1 = call <2 x double> @llvm.fma.v2f64(<2 x double> %minus, <2 x double> <double 0x3FF921FB54400000, double 0x3FF921FB54400000>, <2 x double> %x)
  %r2 = call <2 x double> @llvm.fma.v2f64(<2 x double> %minus, <2 x double> <double 0x3DD0B4611A600000, double 0x3DD0B4611A600000>, <2 x double> %r1)
  %r = call <2 x double> @llvm.fma.v2f64(<2 x double> %minus, <2 x double> <double 0x3BA3198A2E037073, double 0x3BA3198A2E037073>, <2 x double> %r2)
  %z = fmul <2 x double> %r, %r
  %sp.4 = call <2 x double> @llvm.fma.v2f64(<2 x double> <double 0x3DE5D93A5ACFD57C, double 0x3DE5D93A5ACFD57C>, <2 x double> %z, <2 x double> <double 0xBE5AE5E68A2B9CEB, double 0xBE5AE5E68A2B9CEB>)
  %sp.3 = call <2 x double> @llvm.fma.v2f64(<2 x double> %sp.4, <2 x double> %z, <2 x double> <double 0x3EC71DE357B1FE7D, double 0x3EC71DE357B1FE7D>)
  %sp.2 = call <2 x double> @llvm.fma.v2f64(<2 x double> %sp.3, <2 x double> %z, <2 x double> <double 0xBF2A01A019C161D5, double 0xBF2A01A019C161D5>)
  %sp.1 = call <2 x double> @llvm.fma.v2f64(<2 x double> %sp.2, <2 x double> %z, <2 x double> <double 0x3F8111111110F8A6, double 0x3F8111111110F8A6>)
  %sp = call <2 x double> @llvm.fma.v2f64(<2 x double> %sp.1, <2 x double> %z, <2 x double> <double 0xBFC5555555555549, double 0xBFC5555555555549>)
  %cp.4 = call <2 x double> @llvm.fma.v2f64(<2 x double> <double 0xBDA8FAE9BE8838D4, double 0xBDA8FAE9BE8838D4>, <2 x double> %z, <2 x double> <double 0x3E21EE9EBDB4B1C4, double 0x3E21EE9EBDB4B1C4>)
  %cp.3 = call <2 x double> @llvm.fma.v2f64(<2 x double> %cp.4, <2 x double> %z, <2 x double> <double 0xBE927E4F809C52AD, double 0xBE927E4F809C52AD>)
  %cp.2 = call <2 x double> @llvm.fma.v2f64(<2 x double> %cp.3, <2 x double> %z, <2 x double> <double 0x3EFA01A019CB1590, double 0x3EFA01A019CB1590>)
  %cp.1 = call <2 x double> @llvm.fma.v2f64(<2 x double> %cp.2, <2 x double> %z, <2 x double> <double 0xBF56C16C16C15177, double 0xBF56C16C16C15177>)
  %cp = call <2 x double> @llvm.fma.v2f64(<2 x double> %cp.1, <2 x double> %z, <2 x double> <double 0x3FA555555555554C, double 0x3FA555555555554C>)
  %rz = fmul <2 x double> %r, %z
  %sine = call <2 x double> @llvm.fma.v2f64(<2 x double> %rz, <2 x double> %sp, <2 x double> %r)
  %hz = fmul <2 x double> %z, <double 0x3FE0000000000000, double 0x3FE0000000000000>
  %one = fsub <2 x double> <double 0x3FF0000000000000, double 0x3FF0000000000000>, %hz
  %lost = fsub <2 x double> <double 0x3FF0000000000000, double 0x3FF0000000000000>, %one
  %rest = fsub <2 x double> %lost, %hz
  %zz = fmul <2 x double> %z, %z
  %tail = call <2 x double> @llvm.fma.v2f64(<2 x double> %zz, <2 x double> %cp, <2 x double> %rest)
  %cosine = fadd <2 x double> %one, %tail
  %low = and <2 x i64> %q, <i64 1, i64 1>
  %odd = icmp ne <2 x i64> %low, <i64 0, i64 0>
  %s.a = select <2 x i1> %odd, <2 x double> %cosine, <2 x double> %sine
  %c.a = select <2 x i1> %odd, <2 x double> %sine, <2 x double> %cosine
  %s.bit = and <2 x i64> %q, <i64 2, i64 2>
  %s.sign = shl <2 x i64> %s.bit, <i64 62, i64 62>
  %q1 = add <2 x i64> %q, <i64 1, i64 1>
  %c.bit = and <2 x i64> %q1, <i64 2, i64 2>
  %c.sign = shl <2 x i64> %c.bit, <i64 62, i64 62>
  %s.i = bitcast <2 x double> %s.a to <2 x i64>
  %c.i = bitcast <2 x double> %c.a to <2 x i64>
  %s.x = xor <2 x i64> %s.i, %s.sign
  %c.x = xor <2 x i64> %c.i, %c.sign
  %s.f = bitcast <2 x i64> %s.x to <2 x double>
  %c.f = bitcast <2 x i64> %c.x to <2 x double>
  br i1 %any, label %slow, label %done
slow:
  %slow.s.0.0 = extractelement <2 x double> %x, i32 0
  %slow.s.0 = call double @sin(double %slow.s.0.0)
  %slow.s.pack0 = insertelement <2 x double> undef, double %slow.s.0, i32 0
  %slow.s.1.0 = extractelement <2 x double> %x, i32 1
  %slow.s.1 = call double @sin(double %slow.s.1.0)
  %slow.s = insertelement <2 x double> %slow.s.pack0, double %slow.s.1, i32 1
  %slow.c.0.0 = extractelement <2 x double> %x, i32 0
  %slow.c.0 = call double @cos(double %slow.c.0.0)
  %slow.c.pack0 = insertelement <2 x double> undef, double %slow.c.0, i32 0
  %slow.c.1.0 = extractelement <2 x double> %x, i32 1
  %slow.c.1 = call double @cos(double %slow.c.1.0)
  %slow.c = insertelement <2 x double> %slow.c.pack0, double %slow.c.1, i32 1
  ; the neighbours of a large argument keep what they would have alone
  %s.l = select <2 x i1> %large, <2 x double> %slow.s, <2 x double> %s.f
  %c.l = select <2 x i1> %large, <2 x double> %slow.c, <2 x double> %c.f
  br label %done
done:
  %s = phi <2 x double> [%s.f, %entry], [%s.l, %slow]
  %c = phi <2 x double> [%c.f, %entry], [%c.l, %slow]
  %pair = insertvalue {<2 x double>, <2 x double>} undef, <2 x double> %s, 0
  %both = insertvalue {<2 x double>, <2 x double>} %pair, <2 x double> %c, 1
  ret {<2 x double>, <2 x double>} %both
}

; Good to 0.005 for positive normal numbers: the bits of a number, read as an integer, are its logarithm with straight
; lines between the powers of two; a parabola takes off most of what that is wrong by.
define internal <2 x double> @rough_log2(<2 x double> %x) alwaysinline nounwind {
  %i = bitcast <2 x double> %x to <2 x i64>
  %high = lshr <2 x i64> %i, <i64 12, i64 12>
  %magic = or <2 x i64> %high, <i64 4841369599423283200, i64 4841369599423283200>
  %float = bitcast <2 x i64> %magic to <2 x double>
  %m.raw = and <2 x i64> %i, <i64 4503599627370495, i64 4503599627370495>
  %m.one = or <2 x i64> %m.raw, <i64 4607182418800017408, i64 4607182418800017408>
  %m = bitcast <2 x i64> %m.one to <2 x double>
  %line = call <2 x double> @llvm.fma.v2f64(<2 x double> %float, <2 x double> <double 0x3D70000000000000, double 0x3D70000000000000>, <2 x double> <double 0xC0B3FFACC4C79AB4, double 0xC0B3FFACC4C79AB4>)
  %slope = call <2 x double> @llvm.fma.v2f64(<2 x double> <double 0xBFD611FE8FE86AE3, double 0xBFD611FE8FE86AE3>, <2 x double> %m, <2 x double> <double 0x3FF06507B987CB91, double 0x3FF06507B987CB91>)
  %log = call <2 x double> @llvm.fma.v2f64(<2 x double> %slope, <2 x double> %m, <2 x double> %line)
  ret <2 x double> %log
}

; Good to 1e-4 relative; the argument is limited to +-1000.
define internal <2 x double> @rough_exp2(<2 x double> %x) alwaysinline nounwind {
  %above = fcmp ogt <2 x double> %x, <double 0xC08F400000000000, double 0xC08F400000000000>
  %x.low = select <2 x i1> %above, <2 x double> %x, <2 x double> <double 0xC08F400000000000, double 0xC08F400000000000>
  %below = fcmp olt <2 x double> %x.low, <double 0x408F400000000000, double 0x408F400000000000>
  %x.held = select <2 x i1> %below, <2 x double> %x.low, <2 x double> <double 0x408F400000000000, double 0x408F400000000000>
  %shifted = fadd <2 x double> %x.held, <double 0x4338000000000000, double 0x4338000000000000>
  %whole = fsub <2 x double> %shifted, <double 0x4338000000000000, double 0x4338000000000000>
  %r = fsub <2 x double> %x.held, %whole
  %i = bitcast <2 x double> %shifted to <2 x i64>
  %exponent = shl <2 x i64> %i, <i64 52, i64 52>
  %p.2 = call <2 x double> @llvm.fma.v2f64(<2 x double> <double 0x3FAC3F760CA1A3FF, double 0x3FAC3F760CA1A3FF>, <2 x double> %r, <2 x double> <double 0x3FCF0DE1BFF8FEDA, double 0x3FCF0DE1BFF8FEDA>)
  %p.1 = call <2 x double> @llvm.fma.v2f64(<2 x double> %p.2, <2 x double> %r, <2 x double> <double 0x3FE62F31ABF4900A, double 0x3FE62F31ABF4900A>)
  %p = call <2 x double> @llvm.fma.v2f64(<2 x double> %p.1, <2 x double> %r, <2 x double> <double 0x3FEFFF6926E013A6, double 0x3FEFFF6926E013A6>)
  %p.bits = bitcast <2 x double> %p to <2 x i64>
  %bits = add <2 x i64> %p.bits, %exponent
  %power = bitcast <2 x i64> %bits to <2 x double>
  ret <2 x double> %power
}

define void @rhs(ptr noalias nocapture %t, ptr noalias nocapture %y, ptr noalias nocapture %c, ptr noalias nocapture %out) nounwind {
  %f.at = getelementptr double, ptr %c, i64 0
  %f = load <2 x double>, ptr %f.at, align 8
  %square.at = getelementptr double, ptr %c, i64 4
  %square = load <2 x double>, ptr %square.at, align 8
  %t_2.at = getelementptr double, ptr %t, i64 0
  %t_2 = load <2 x double>, ptr %t_2.at, align 8
  %x.at = getelementptr double, ptr %y, i64 0
  %x = load <2 x double>, ptr %x.at, align 8
  %x_dot.at = getelementptr double, ptr %y, i64 2
  %x_dot = load <2 x double>, ptr %x_dot.at, align 8
  %sin_t.pair = call {<2 x double>, <2 x double>} @sincos2(<2 x double> %t_2)
  %sin_t = extractvalue {<2 x double>, <2 x double>} %sin_t.pair, 0
  %drive = fmul <2 x double> %f, %sin_t
  %pull_minus = fneg <2 x double> %square
  %pull = call <2 x double> @llvm.fma.v2f64(<2 x double> %pull_minus, <2 x double> %x, <2 x double> %drive)
  %out.0 = getelementptr double, ptr %out, i64 0
  store <2 x double> %x_dot, ptr %out.0, align 8
  %out.1 = getelementptr double, ptr %out, i64 2
  store <2 x double> %pull, ptr %out.1, align 8
  ret void
}

define void @attempt_stage0(ptr noalias nocapture %t, ptr noalias nocapture %y, ptr noalias nocapture %s, ptr noalias nocapture %k, ptr noalias nocapture %out) nounwind {
  %t_.at = getelementptr double, ptr %t, i64 0
  %t_ = load <2 x double>, ptr %t_.at, align 8
  %y_0_.at = getelementptr double, ptr %y, i64 0
  %y_0_ = load <2 x double>, ptr %y_0_.at, align 8
  %y_1_.at = getelementptr double, ptr %y, i64 2
  %y_1_ = load <2 x double>, ptr %y_1_.at, align 8
  %out.0 = getelementptr double, ptr %out, i64 0
  store <2 x double> %y_0_, ptr %out.0, align 8
  %out.1 = getelementptr double, ptr %out, i64 2
  store <2 x double> %y_1_, ptr %out.1, align 8
  %out.2 = getelementptr double, ptr %out, i64 4
  store <2 x double> %t_, ptr %out.2, align 8
  ret void
}

define void @attempt_stage1(ptr noalias nocapture %t, ptr noalias nocapture %y, ptr noalias nocapture %s, ptr noalias nocapture %k, ptr noalias nocapture %out) nounwind {
  %t_.at = getelementptr double, ptr %t, i64 0
  %t_ = load <2 x double>, ptr %t_.at, align 8
  %y_0_.at = getelementptr double, ptr %y, i64 0
  %y_0_ = load <2 x double>, ptr %y_0_.at, align 8
  %y_1_.at = getelementptr double, ptr %y, i64 2
  %y_1_ = load <2 x double>, ptr %y_1_.at, align 8
  %largest_.at = getelementptr double, ptr %s, i64 0
  %largest_ = load <2 x double>, ptr %largest_.at, align 8
  %direction_.at = getelementptr double, ptr %s, i64 2
  %direction_ = load <2 x double>, ptr %direction_.at, align 8
  %proposal_.at = getelementptr double, ptr %y, i64 8
  %proposal_ = load <2 x double>, ptr %proposal_.at, align 8
  %k_0_0_.at = getelementptr double, ptr %k, i64 0
  %k_0_0_ = load <2 x double>, ptr %k_0_0_.at, align 8
  %k_0_1_.at = getelementptr double, ptr %k, i64 2
  %k_0_1_ = load <2 x double>, ptr %k_0_1_.at, align 8
  %v_0_ = call <2 x double> @llvm.fabs.v2f64(<2 x double> %t_)
  %v_1_ = fmul <2 x double> %v_0_, <double 0x3CF0000000000000, double 0x3CF0000000000000>
  %v_2_.test = fcmp ogt <2 x double> %proposal_, %v_1_
  %v_2_ = select <2 x i1> %v_2_.test, <2 x double> %proposal_, <2 x double> %v_1_
  %v_3_ = fmul <2 x double> %v_2_, <double 0x3FF000000044B830, double 0x3FF000000044B830>
  %v_4_.test = fcmp ole <2 x double> %largest_, %v_3_
  %v_4_ = select <2 x i1> %v_4_.test, <2 x double> <double 0x3FF0000000000000, double 0x3FF0000000000000>, <2 x double> <double 0x0000000000000000, double 0x0000000000000000>
  %v_5_.test = fcmp une <2 x double> %v_4_, <double 0x0000000000000000, double 0x0000000000000000>
  %v_5_ = select <2 x i1> %v_5_.test, <2 x double> %largest_, <2 x double> %v_2_
  %v_6_ = fmul <2 x double> %v_5_, %direction_
  %v_7_ = fmul <2 x double> %k_0_0_, <double 0x3FC49BA5E353F7CF, double 0x3FC49BA5E353F7CF>
  %v_8_ = fmul <2 x double> %k_0_1_, <double 0x3FC49BA5E353F7CF, double 0x3FC49BA5E353F7CF>
  %v_9_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %v_6_, <2 x double> %v_7_, <2 x double> %y_0_)
  %v_10_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %v_6_, <2 x double> %v_8_, <2 x double> %y_1_)
  %v_11_ = call <2 x double> @llvm.fma.v2f64(<2 x double> <double 0x3FC49BA5E353F7CF, double 0x3FC49BA5E353F7CF>, <2 x double> %v_6_, <2 x double> %t_)
  %out.0 = getelementptr double, ptr %out, i64 0
  store <2 x double> %v_9_, ptr %out.0, align 8
  %out.1 = getelementptr double, ptr %out, i64 2
  store <2 x double> %v_10_, ptr %out.1, align 8
  %out.2 = getelementptr double, ptr %out, i64 4
  store <2 x double> %v_11_, ptr %out.2, align 8
  ret void
}

define void @attempt_stage2(ptr noalias nocapture %t, ptr noalias nocapture %y, ptr noalias nocapture %s, ptr noalias nocapture %k, ptr noalias nocapture %out) nounwind {
  %t_.at = getelementptr double, ptr %t, i64 0
  %t_ = load <2 x double>, ptr %t_.at, align 8
  %y_0_.at = getelementptr double, ptr %y, i64 0
  %y_0_ = load <2 x double>, ptr %y_0_.at, align 8
  %y_1_.at = getelementptr double, ptr %y, i64 2
  %y_1_ = load <2 x double>, ptr %y_1_.at, align 8
  %largest_.at = getelementptr double, ptr %s, i64 0
  %largest_ = load <2 x double>, ptr %largest_.at, align 8
  %direction_.at = getelementptr double, ptr %s, i64 2
  %direction_ = load <2 x double>, ptr %direction_.at, align 8
  %proposal_.at = getelementptr double, ptr %y, i64 8
  %proposal_ = load <2 x double>, ptr %proposal_.at, align 8
  %k_0_0_.at = getelementptr double, ptr %k, i64 0
  %k_0_0_ = load <2 x double>, ptr %k_0_0_.at, align 8
  %k_0_1_.at = getelementptr double, ptr %k, i64 2
  %k_0_1_ = load <2 x double>, ptr %k_0_1_.at, align 8
  %k_1_0_.at = getelementptr double, ptr %k, i64 4
  %k_1_0_ = load <2 x double>, ptr %k_1_0_.at, align 8
  %k_1_1_.at = getelementptr double, ptr %k, i64 6
  %k_1_1_ = load <2 x double>, ptr %k_1_1_.at, align 8
  %v_0_ = call <2 x double> @llvm.fabs.v2f64(<2 x double> %t_)
  %v_1_ = fmul <2 x double> %v_0_, <double 0x3CF0000000000000, double 0x3CF0000000000000>
  %v_2_.test = fcmp ogt <2 x double> %proposal_, %v_1_
  %v_2_ = select <2 x i1> %v_2_.test, <2 x double> %proposal_, <2 x double> %v_1_
  %v_3_ = fmul <2 x double> %v_2_, <double 0x3FF000000044B830, double 0x3FF000000044B830>
  %v_4_.test = fcmp ole <2 x double> %largest_, %v_3_
  %v_4_ = select <2 x i1> %v_4_.test, <2 x double> <double 0x3FF0000000000000, double 0x3FF0000000000000>, <2 x double> <double 0x0000000000000000, double 0x0000000000000000>
  %v_5_.test = fcmp une <2 x double> %v_4_, <double 0x0000000000000000, double 0x0000000000000000>
  %v_5_ = select <2 x i1> %v_5_.test, <2 x double> %largest_, <2 x double> %v_2_
  %v_6_ = fmul <2 x double> %v_5_, %direction_
  %v_7_ = fmul <2 x double> %k_0_0_, <double 0xBF815E4E4FE8123E, double 0xBF815E4E4FE8123E>
  %v_8_ = fmul <2 x double> %k_0_1_, <double 0xBF815E4E4FE8123E, double 0xBF815E4E4FE8123E>
  %v_9_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_1_0_, <2 x double> <double 0x3FD57883DAF1F0B3, double 0x3FD57883DAF1F0B3>, <2 x double> %v_7_)
  %v_10_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_1_1_, <2 x double> <double 0x3FD57883DAF1F0B3, double 0x3FD57883DAF1F0B3>, <2 x double> %v_8_)
  %v_11_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %v_6_, <2 x double> %v_9_, <2 x double> %y_0_)
  %v_12_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %v_6_, <2 x double> %v_10_, <2 x double> %y_1_)
  %v_13_ = call <2 x double> @llvm.fma.v2f64(<2 x double> <double 0x3FD4ED916872B021, double 0x3FD4ED916872B021>, <2 x double> %v_6_, <2 x double> %t_)
  %out.0 = getelementptr double, ptr %out, i64 0
  store <2 x double> %v_11_, ptr %out.0, align 8
  %out.1 = getelementptr double, ptr %out, i64 2
  store <2 x double> %v_12_, ptr %out.1, align 8
  %out.2 = getelementptr double, ptr %out, i64 4
  store <2 x double> %v_13_, ptr %out.2, align 8
  ret void
}

define void @attempt_stage3(ptr noalias nocapture %t, ptr noalias nocapture %y, ptr noalias nocapture %s, ptr noalias nocapture %k, ptr noalias nocapture %out) nounwind {
  %t_.at = getelementptr double, ptr %t, i64 0
  %t_ = load <2 x double>, ptr %t_.at, align 8
  %y_0_.at = getelementptr double, ptr %y, i64 0
  %y_0_ = load <2 x double>, ptr %y_0_.at, align 8
  %y_1_.at = getelementptr double, ptr %y, i64 2
  %y_1_ = load <2 x double>, ptr %y_1_.at, align 8
  %largest_.at = getelementptr double, ptr %s, i64 0
  %largest_ = load <2 x double>, ptr %largest_.at, align 8
  %direction_.at = getelementptr double, ptr %s, i64 2
  %direction_ = load <2 x double>, ptr %direction_.at, align 8
  %proposal_.at = getelementptr double, ptr %y, i64 8
  %proposal_ = load <2 x double>, ptr %proposal_.at, align 8
  %k_0_0_.at = getelementptr double, ptr %k, i64 0
  %k_0_0_ = load <2 x double>, ptr %k_0_0_.at, align 8
  %k_0_1_.at = getelementptr double, ptr %k, i64 2
  %k_0_1_ = load <2 x double>, ptr %k_0_1_.at, align 8
  %k_1_0_.at = getelementptr double, ptr %k, i64 4
  %k_1_0_ = load <2 x double>, ptr %k_1_0_.at, align 8
  %k_1_1_.at = getelementptr double, ptr %k, i64 6
  %k_1_1_ = load <2 x double>, ptr %k_1_1_.at, align 8
  %k_2_0_.at = getelementptr double, ptr %k, i64 8
  %k_2_0_ = load <2 x double>, ptr %k_2_0_.at, align 8
  %k_2_1_.at = getelementptr double, ptr %k, i64 10
  %k_2_1_ = load <2 x double>, ptr %k_2_1_.at, align 8
  %v_0_ = call <2 x double> @llvm.fabs.v2f64(<2 x double> %t_)
  %v_1_ = fmul <2 x double> %v_0_, <double 0x3CF0000000000000, double 0x3CF0000000000000>
  %v_2_.test = fcmp ogt <2 x double> %proposal_, %v_1_
  %v_2_ = select <2 x i1> %v_2_.test, <2 x double> %proposal_, <2 x double> %v_1_
  %v_3_ = fmul <2 x double> %v_2_, <double 0x3FF000000044B830, double 0x3FF000000044B830>
  %v_4_.test = fcmp ole <2 x double> %largest_, %v_3_
  %v_4_ = select <2 x i1> %v_4_.test, <2 x double> <double 0x3FF0000000000000, double 0x3FF0000000000000>, <2 x double> <double 0x0000000000000000, double 0x0000000000000000>
  %v_5_.test = fcmp une <2 x double> %v_4_, <double 0x0000000000000000, double 0x0000000000000000>
  %v_5_ = select <2 x i1> %v_5_.test, <2 x double> %largest_, <2 x double> %v_2_
  %v_6_ = fmul <2 x double> %v_5_, %direction_
  %v_7_ = fmul <2 x double> %k_0_0_, <double 0x40072D5E94FE3235, double 0x40072D5E94FE3235>
  %v_8_ = fmul <2 x double> %k_0_1_, <double 0x40072D5E94FE3235, double 0x40072D5E94FE3235>
  %v_9_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_1_0_, <2 x double> <double 0xC019701343D4287B, double 0xC019701343D4287B>, <2 x double> %v_7_)
  %v_10_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_1_1_, <2 x double> <double 0xC019701343D4287B, double 0xC019701343D4287B>, <2 x double> %v_8_)
  %v_11_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_2_0_, <2 x double> <double 0x401172FD92EEA8FA, double 0x401172FD92EEA8FA>, <2 x double> %v_9_)
  %v_12_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_2_1_, <2 x double> <double 0x401172FD92EEA8FA, double 0x401172FD92EEA8FA>, <2 x double> %v_10_)
  %v_13_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %v_6_, <2 x double> %v_11_, <2 x double> %y_0_)
  %v_14_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %v_6_, <2 x double> %v_12_, <2 x double> %y_1_)
  %v_15_ = call <2 x double> @llvm.fma.v2f64(<2 x double> <double 0x3FECCCCCCCCCCCCD, double 0x3FECCCCCCCCCCCCD>, <2 x double> %v_6_, <2 x double> %t_)
  %out.0 = getelementptr double, ptr %out, i64 0
  store <2 x double> %v_13_, ptr %out.0, align 8
  %out.1 = getelementptr double, ptr %out, i64 2
  store <2 x double> %v_14_, ptr %out.1, align 8
  %out.2 = getelementptr double, ptr %out, i64 4
  store <2 x double> %v_15_, ptr %out.2, align 8
  ret void
}

define void @attempt_stage4(ptr noalias nocapture %t, ptr noalias nocapture %y, ptr noalias nocapture %s, ptr noalias nocapture %k, ptr noalias nocapture %out) nounwind {
  %t_.at = getelementptr double, ptr %t, i64 0
  %t_ = load <2 x double>, ptr %t_.at, align 8
  %y_0_.at = getelementptr double, ptr %y, i64 0
  %y_0_ = load <2 x double>, ptr %y_0_.at, align 8
  %y_1_.at = getelementptr double, ptr %y, i64 2
  %y_1_ = load <2 x double>, ptr %y_1_.at, align 8
  %largest_.at = getelementptr double, ptr %s, i64 0
  %largest_ = load <2 x double>, ptr %largest_.at, align 8
  %direction_.at = getelementptr double, ptr %s, i64 2
  %direction_ = load <2 x double>, ptr %direction_.at, align 8
  %proposal_.at = getelementptr double, ptr %y, i64 8
  %proposal_ = load <2 x double>, ptr %proposal_.at, align 8
  %k_0_0_.at = getelementptr double, ptr %k, i64 0
  %k_0_0_ = load <2 x double>, ptr %k_0_0_.at, align 8
  %k_0_1_.at = getelementptr double, ptr %k, i64 2
  %k_0_1_ = load <2 x double>, ptr %k_0_1_.at, align 8
  %k_1_0_.at = getelementptr double, ptr %k, i64 4
  %k_1_0_ = load <2 x double>, ptr %k_1_0_.at, align 8
  %k_1_1_.at = getelementptr double, ptr %k, i64 6
  %k_1_1_ = load <2 x double>, ptr %k_1_1_.at, align 8
  %k_2_0_.at = getelementptr double, ptr %k, i64 8
  %k_2_0_ = load <2 x double>, ptr %k_2_0_.at, align 8
  %k_2_1_.at = getelementptr double, ptr %k, i64 10
  %k_2_1_ = load <2 x double>, ptr %k_2_1_.at, align 8
  %k_3_0_.at = getelementptr double, ptr %k, i64 12
  %k_3_0_ = load <2 x double>, ptr %k_3_0_.at, align 8
  %k_3_1_.at = getelementptr double, ptr %k, i64 14
  %k_3_1_ = load <2 x double>, ptr %k_3_1_.at, align 8
  %v_0_ = call <2 x double> @llvm.fabs.v2f64(<2 x double> %t_)
  %v_1_ = fmul <2 x double> %v_0_, <double 0x3CF0000000000000, double 0x3CF0000000000000>
  %v_2_.test = fcmp ogt <2 x double> %proposal_, %v_1_
  %v_2_ = select <2 x i1> %v_2_.test, <2 x double> %proposal_, <2 x double> %v_1_
  %v_3_ = fmul <2 x double> %v_2_, <double 0x3FF000000044B830, double 0x3FF000000044B830>
  %v_4_.test = fcmp ole <2 x double> %largest_, %v_3_
  %v_4_ = select <2 x i1> %v_4_.test, <2 x double> <double 0x3FF0000000000000, double 0x3FF0000000000000>, <2 x double> <double 0x0000000000000000, double 0x0000000000000000>
  %v_5_.test = fcmp une <2 x double> %v_4_, <double 0x0000000000000000, double 0x0000000000000000>
  %v_5_ = select <2 x i1> %v_5_.test, <2 x double> %largest_, <2 x double> %v_2_
  %v_6_ = fmul <2 x double> %v_5_, %direction_
  %v_7_ = fmul <2 x double> %k_0_0_, <double 0x40154DAF827440C7, double 0x40154DAF827440C7>
  %v_8_ = fmul <2 x double> %k_0_1_, <double 0x40154DAF827440C7, double 0x40154DAF827440C7>
  %v_9_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_1_0_, <2 x double> <double 0xC0277F6DAAA052D3, double 0xC0277F6DAAA052D3>, <2 x double> %v_7_)
  %v_10_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_1_1_, <2 x double> <double 0xC0277F6DAAA052D3, double 0xC0277F6DAAA052D3>, <2 x double> %v_8_)
  %v_11_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_2_0_, <2 x double> <double 0x401DFB6EAA5E5F6A, double 0x401DFB6EAA5E5F6A>, <2 x double> %v_9_)
  %v_12_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_2_1_, <2 x double> <double 0x401DFB6EAA5E5F6A, double 0x401DFB6EAA5E5F6A>, <2 x double> %v_10_)
  %v_13_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_3_0_, <2 x double> <double 0xBFB7ADC1B510A9A4, double 0xBFB7ADC1B510A9A4>, <2 x double> %v_11_)
  %v_14_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_3_1_, <2 x double> <double 0xBFB7ADC1B510A9A4, double 0xBFB7ADC1B510A9A4>, <2 x double> %v_12_)
  %v_15_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %v_6_, <2 x double> %v_13_, <2 x double> %y_0_)
  %v_16_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %v_6_, <2 x double> %v_14_, <2 x double> %y_1_)
  %v_17_ = call <2 x double> @llvm.fma.v2f64(<2 x double> <double 0x3FEF5C5E85EDBF1D, double 0x3FEF5C5E85EDBF1D>, <2 x double> %v_6_, <2 x double> %t_)
  %out.0 = getelementptr double, ptr %out, i64 0
  store <2 x double> %v_15_, ptr %out.0, align 8
  %out.1 = getelementptr double, ptr %out, i64 2
  store <2 x double> %v_16_, ptr %out.1, align 8
  %out.2 = getelementptr double, ptr %out, i64 4
  store <2 x double> %v_17_, ptr %out.2, align 8
  ret void
}

define void @attempt_stage5(ptr noalias nocapture %t, ptr noalias nocapture %y, ptr noalias nocapture %s, ptr noalias nocapture %k, ptr noalias nocapture %out) nounwind {
  %t_.at = getelementptr double, ptr %t, i64 0
  %t_ = load <2 x double>, ptr %t_.at, align 8
  %y_0_.at = getelementptr double, ptr %y, i64 0
  %y_0_ = load <2 x double>, ptr %y_0_.at, align 8
  %y_1_.at = getelementptr double, ptr %y, i64 2
  %y_1_ = load <2 x double>, ptr %y_1_.at, align 8
  %largest_.at = getelementptr double, ptr %s, i64 0
  %largest_ = load <2 x double>, ptr %largest_.at, align 8
  %direction_.at = getelementptr double, ptr %s, i64 2
  %direction_ = load <2 x double>, ptr %direction_.at, align 8
  %proposal_.at = getelementptr double, ptr %y, i64 8
  %proposal_ = load <2 x double>, ptr %proposal_.at, align 8
  %k_0_0_.at = getelementptr double, ptr %k, i64 0
  %k_0_0_ = load <2 x double>, ptr %k_0_0_.at, align 8
  %k_0_1_.at = getelementptr double, ptr %k, i64 2
  %k_0_1_ = load <2 x double>, ptr %k_0_1_.at, align 8
  %k_1_0_.at = getelementptr double, ptr %k, i64 4
  %k_1_0_ = load <2 x double>, ptr %k_1_0_.at, align 8
  %k_1_1_.at = getelementptr double, ptr %k, i64 6
  %k_1_1_ = load <2 x double>, ptr %k_1_1_.at, align 8
  %k_2_0_.at = getelementptr double, ptr %k, i64 8
  %k_2_0_ = load <2 x double>, ptr %k_2_0_.at, align 8
  %k_2_1_.at = getelementptr double, ptr %k, i64 10
  %k_2_1_ = load <2 x double>, ptr %k_2_1_.at, align 8
  %k_3_0_.at = getelementptr double, ptr %k, i64 12
  %k_3_0_ = load <2 x double>, ptr %k_3_0_.at, align 8
  %k_3_1_.at = getelementptr double, ptr %k, i64 14
  %k_3_1_ = load <2 x double>, ptr %k_3_1_.at, align 8
  %k_4_0_.at = getelementptr double, ptr %k, i64 16
  %k_4_0_ = load <2 x double>, ptr %k_4_0_.at, align 8
  %k_4_1_.at = getelementptr double, ptr %k, i64 18
  %k_4_1_ = load <2 x double>, ptr %k_4_1_.at, align 8
  %v_0_ = call <2 x double> @llvm.fabs.v2f64(<2 x double> %t_)
  %v_1_ = fmul <2 x double> %v_0_, <double 0x3CF0000000000000, double 0x3CF0000000000000>
  %v_2_.test = fcmp ogt <2 x double> %proposal_, %v_1_
  %v_2_ = select <2 x i1> %v_2_.test, <2 x double> %proposal_, <2 x double> %v_1_
  %v_3_ = fmul <2 x double> %v_2_, <double 0x3FF000000044B830, double 0x3FF000000044B830>
  %v_4_.test = fcmp ole <2 x double> %largest_, %v_3_
  %v_4_ = select <2 x i1> %v_4_.test, <2 x double> <double 0x3FF0000000000000, double 0x3FF0000000000000>, <2 x double> <double 0x0000000000000000, double 0x0000000000000000>
  %v_5_.test = fcmp une <2 x double> %v_4_, <double 0x0000000000000000, double 0x0000000000000000>
  %v_5_ = select <2 x i1> %v_5_.test, <2 x double> %largest_, <2 x double> %v_2_
  %v_6_ = fmul <2 x double> %v_5_, %direction_
  %v_7_ = fmul <2 x double> %k_0_0_, <double 0x401772216029AA0E, double 0x401772216029AA0E>
  %v_8_ = fmul <2 x double> %k_0_1_, <double 0x401772216029AA0E, double 0x401772216029AA0E>
  %v_9_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_1_0_, <2 x double> <double 0xC029D7894A598BA8, double 0xC029D7894A598BA8>, <2 x double> %v_7_)
  %v_10_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_1_1_, <2 x double> <double 0xC029D7894A598BA8, double 0xC029D7894A598BA8>, <2 x double> %v_8_)
  %v_11_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_2_0_, <2 x double> <double 0x40205198AB50D56D, double 0x40205198AB50D56D>, <2 x double> %v_9_)
  %v_12_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_2_1_, <2 x double> <double 0x40205198AB50D56D, double 0x40205198AB50D56D>, <2 x double> %v_10_)
  %v_13_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_3_0_, <2 x double> <double 0xBFB253648F20EF47, double 0xBFB253648F20EF47>, <2 x double> %v_11_)
  %v_14_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_3_1_, <2 x double> <double 0xBFB253648F20EF47, double 0xBFB253648F20EF47>, <2 x double> %v_12_)
  %v_15_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_4_0_, <2 x double> <double 0xBF9CF28FDBB9DB09, double 0xBF9CF28FDBB9DB09>, <2 x double> %v_13_)
  %v_16_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_4_1_, <2 x double> <double 0xBF9CF28FDBB9DB09, double 0xBF9CF28FDBB9DB09>, <2 x double> %v_14_)
  %v_17_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %v_6_, <2 x double> %v_15_, <2 x double> %y_0_)
  %v_18_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %v_6_, <2 x double> %v_16_, <2 x double> %y_1_)
  %v_19_ = fadd <2 x double> %t_, %v_6_
  %out.0 = getelementptr double, ptr %out, i64 0
  store <2 x double> %v_17_, ptr %out.0, align 8
  %out.1 = getelementptr double, ptr %out, i64 2
  store <2 x double> %v_18_, ptr %out.1, align 8
  %out.2 = getelementptr double, ptr %out, i64 4
  store <2 x double> %v_19_, ptr %out.2, align 8
  ret void
}

define void @attempt_stage6(ptr noalias nocapture %t, ptr noalias nocapture %y, ptr noalias nocapture %s, ptr noalias nocapture %k, ptr noalias nocapture %out) nounwind {
  %t_.at = getelementptr double, ptr %t, i64 0
  %t_ = load <2 x double>, ptr %t_.at, align 8
  %y_0_.at = getelementptr double, ptr %y, i64 0
  %y_0_ = load <2 x double>, ptr %y_0_.at, align 8
  %y_1_.at = getelementptr double, ptr %y, i64 2
  %y_1_ = load <2 x double>, ptr %y_1_.at, align 8
  %largest_.at = getelementptr double, ptr %s, i64 0
  %largest_ = load <2 x double>, ptr %largest_.at, align 8
  %direction_.at = getelementptr double, ptr %s, i64 2
  %direction_ = load <2 x double>, ptr %direction_.at, align 8
  %proposal_.at = getelementptr double, ptr %y, i64 8
  %proposal_ = load <2 x double>, ptr %proposal_.at, align 8
  %k_0_0_.at = getelementptr double, ptr %k, i64 0
  %k_0_0_ = load <2 x double>, ptr %k_0_0_.at, align 8
  %k_0_1_.at = getelementptr double, ptr %k, i64 2
  %k_0_1_ = load <2 x double>, ptr %k_0_1_.at, align 8
  %k_1_0_.at = getelementptr double, ptr %k, i64 4
  %k_1_0_ = load <2 x double>, ptr %k_1_0_.at, align 8
  %k_1_1_.at = getelementptr double, ptr %k, i64 6
  %k_1_1_ = load <2 x double>, ptr %k_1_1_.at, align 8
  %k_2_0_.at = getelementptr double, ptr %k, i64 8
  %k_2_0_ = load <2 x double>, ptr %k_2_0_.at, align 8
  %k_2_1_.at = getelementptr double, ptr %k, i64 10
  %k_2_1_ = load <2 x double>, ptr %k_2_1_.at, align 8
  %k_3_0_.at = getelementptr double, ptr %k, i64 12
  %k_3_0_ = load <2 x double>, ptr %k_3_0_.at, align 8
  %k_3_1_.at = getelementptr double, ptr %k, i64 14
  %k_3_1_ = load <2 x double>, ptr %k_3_1_.at, align 8
  %k_4_0_.at = getelementptr double, ptr %k, i64 16
  %k_4_0_ = load <2 x double>, ptr %k_4_0_.at, align 8
  %k_4_1_.at = getelementptr double, ptr %k, i64 18
  %k_4_1_ = load <2 x double>, ptr %k_4_1_.at, align 8
  %k_5_0_.at = getelementptr double, ptr %k, i64 20
  %k_5_0_ = load <2 x double>, ptr %k_5_0_.at, align 8
  %k_5_1_.at = getelementptr double, ptr %k, i64 22
  %k_5_1_ = load <2 x double>, ptr %k_5_1_.at, align 8
  %v_0_ = call <2 x double> @llvm.fabs.v2f64(<2 x double> %t_)
  %v_1_ = fmul <2 x double> %v_0_, <double 0x3CF0000000000000, double 0x3CF0000000000000>
  %v_2_.test = fcmp ogt <2 x double> %proposal_, %v_1_
  %v_2_ = select <2 x i1> %v_2_.test, <2 x double> %proposal_, <2 x double> %v_1_
  %v_3_ = fmul <2 x double> %v_2_, <double 0x3FF000000044B830, double 0x3FF000000044B830>
  %v_4_.test = fcmp ole <2 x double> %largest_, %v_3_
  %v_4_ = select <2 x i1> %v_4_.test, <2 x double> <double 0x3FF0000000000000, double 0x3FF0000000000000>, <2 x double> <double 0x0000000000000000, double 0x0000000000000000>
  %v_5_.test = fcmp une <2 x double> %v_4_, <double 0x0000000000000000, double 0x0000000000000000>
  %v_5_ = select <2 x i1> %v_5_.test, <2 x double> %largest_, <2 x double> %v_2_
  %v_6_ = fmul <2 x double> %v_5_, %direction_
  %v_7_ = fmul <2 x double> %k_0_0_, <double 0x3FB8B1A71ED4A6EE, double 0x3FB8B1A71ED4A6EE>
  %v_8_ = fmul <2 x double> %k_0_1_, <double 0x3FB8B1A71ED4A6EE, double 0x3FB8B1A71ED4A6EE>
  %v_9_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_1_0_, <2 x double> <double 0x3F847AE147AE147B, double 0x3F847AE147AE147B>, <2 x double> %v_7_)
  %v_10_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_1_1_, <2 x double> <double 0x3F847AE147AE147B, double 0x3F847AE147AE147B>, <2 x double> %v_8_)
  %v_11_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_2_0_, <2 x double> <double 0x3FDEB683148E0688, double 0x3FDEB683148E0688>, <2 x double> %v_9_)
  %v_12_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_2_1_, <2 x double> <double 0x3FDEB683148E0688, double 0x3FDEB683148E0688>, <2 x double> %v_10_)
  %v_13_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_3_0_, <2 x double> <double 0x3FF6106B4B6ADDDB, double 0x3FF6106B4B6ADDDB>, <2 x double> %v_11_)
  %v_14_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_3_1_, <2 x double> <double 0x3FF6106B4B6ADDDB, double 0x3FF6106B4B6ADDDB>, <2 x double> %v_12_)
  %v_15_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_4_0_, <2 x double> <double 0xC00A520FF752EA91, double 0xC00A520FF752EA91>, <2 x double> %v_13_)
  %v_16_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_4_1_, <2 x double> <double 0xC00A520FF752EA91, double 0xC00A520FF752EA91>, <2 x double> %v_14_)
  %v_17_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_5_0_, <2 x double> <double 0x40029901D4CD6786, double 0x40029901D4CD6786>, <2 x double> %v_15_)
  %v_18_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_5_1_, <2 x double> <double 0x40029901D4CD6786, double 0x40029901D4CD6786>, <2 x double> %v_16_)
  %v_19_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %v_6_, <2 x double> %v_17_, <2 x double> %y_0_)
  %v_20_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %v_6_, <2 x double> %v_18_, <2 x double> %y_1_)
  %v_21_ = fadd <2 x double> %t_, %v_6_
  %out.0 = getelementptr double, ptr %out, i64 0
  store <2 x double> %v_19_, ptr %out.0, align 8
  %out.1 = getelementptr double, ptr %out, i64 2
  store <2 x double> %v_20_, ptr %out.1, align 8
  %out.2 = getelementptr double, ptr %out, i64 4
  store <2 x double> %v_21_, ptr %out.2, align 8
  ret void
}

define void @start_stage0(ptr noalias nocapture %t, ptr noalias nocapture %y, ptr noalias nocapture %s, ptr noalias nocapture %k, ptr noalias nocapture %out) nounwind {
  %t_.at = getelementptr double, ptr %t, i64 0
  %t_ = load <2 x double>, ptr %t_.at, align 8
  %y_0_.at = getelementptr double, ptr %y, i64 0
  %y_0_ = load <2 x double>, ptr %y_0_.at, align 8
  %y_1_.at = getelementptr double, ptr %y, i64 2
  %y_1_ = load <2 x double>, ptr %y_1_.at, align 8
  %out.0 = getelementptr double, ptr %out, i64 0
  store <2 x double> %y_0_, ptr %out.0, align 8
  %out.1 = getelementptr double, ptr %out, i64 2
  store <2 x double> %y_1_, ptr %out.1, align 8
  %out.2 = getelementptr double, ptr %out, i64 4
  store <2 x double> %t_, ptr %out.2, align 8
  ret void
}

define void @start_stage1(ptr noalias nocapture %t, ptr noalias nocapture %y, ptr noalias nocapture %s, ptr noalias nocapture %k, ptr noalias nocapture %out) nounwind {
  %t_.at = getelementptr double, ptr %t, i64 0
  %t_ = load <2 x double>, ptr %t_.at, align 8
  %y_0_.at = getelementptr double, ptr %y, i64 0
  %y_0_ = load <2 x double>, ptr %y_0_.at, align 8
  %y_1_.at = getelementptr double, ptr %y, i64 2
  %y_1_ = load <2 x double>, ptr %y_1_.at, align 8
  %largest_.at = getelementptr double, ptr %s, i64 0
  %largest_ = load <2 x double>, ptr %largest_.at, align 8
  %direction_.at = getelementptr double, ptr %s, i64 2
  %direction_ = load <2 x double>, ptr %direction_.at, align 8
  %rtol_.at = getelementptr double, ptr %s, i64 4
  %rtol_ = load <2 x double>, ptr %rtol_.at, align 8
  %atol_.at = getelementptr double, ptr %s, i64 6
  %atol_ = load <2 x double>, ptr %atol_.at, align 8
  %k_0_0_.at = getelementptr double, ptr %k, i64 0
  %k_0_0_ = load <2 x double>, ptr %k_0_0_.at, align 8
  %k_0_1_.at = getelementptr double, ptr %k, i64 2
  %k_0_1_ = load <2 x double>, ptr %k_0_1_.at, align 8
  %v_0_ = call <2 x double> @llvm.fabs.v2f64(<2 x double> %y_0_)
  %v_1_ = call <2 x double> @llvm.fabs.v2f64(<2 x double> %y_1_)
  %v_2_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %rtol_, <2 x double> %v_0_, <2 x double> %atol_)
  %v_3_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %rtol_, <2 x double> %v_1_, <2 x double> %atol_)
  %v_4_ = fdiv <2 x double> <double 0x3FF0000000000000, double 0x3FF0000000000000>, %v_2_
  %v_5_ = fdiv <2 x double> <double 0x3FF0000000000000, double 0x3FF0000000000000>, %v_3_
  %v_6_ = fmul <2 x double> %y_0_, %v_4_
  %v_7_ = fmul <2 x double> %v_6_, %v_6_
  %v_8_ = fmul <2 x double> %y_1_, %v_5_
  %v_9_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %v_8_, <2 x double> %v_8_, <2 x double> %v_7_)
  %v_10_ = fmul <2 x double> %v_9_, <double 0x3FE0000000000000, double 0x3FE0000000000000>
  %v_11_ = call <2 x double> @llvm.sqrt.v2f64(<2 x double> %v_10_)
  %v_12_ = fmul <2 x double> %k_0_0_, %v_4_
  %v_13_ = fmul <2 x double> %v_12_, %v_12_
  %v_14_ = fmul <2 x double> %k_0_1_, %v_5_
  %v_15_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %v_14_, <2 x double> %v_14_, <2 x double> %v_13_)
  %v_16_ = fmul <2 x double> %v_15_, <double 0x3FE0000000000000, double 0x3FE0000000000000>
  %v_17_ = call <2 x double> @llvm.sqrt.v2f64(<2 x double> %v_16_)
  %v_18_.test = fcmp olt <2 x double> %v_11_, %v_17_
  %v_18_ = select <2 x i1> %v_18_.test, <2 x double> %v_11_, <2 x double> %v_17_
  %v_19_.test = fcmp olt <2 x double> %v_18_, <double 0x3EE4F8B588E368F1, double 0x3EE4F8B588E368F1>
  %v_19_ = select <2 x i1> %v_19_.test, <2 x double> <double 0x3FF0000000000000, double 0x3FF0000000000000>, <2 x double> <double 0x0000000000000000, double 0x0000000000000000>
  %v_20_ = fmul <2 x double> %v_11_, <double 0x3F847AE147AE147B, double 0x3F847AE147AE147B>
  %v_21_.test = fcmp ogt <2 x double> %v_17_, <double 0x3EE4F8B588E368F1, double 0x3EE4F8B588E368F1>
  %v_21_ = select <2 x i1> %v_21_.test, <2 x double> %v_17_, <2 x double> <double 0x3EE4F8B588E368F1, double 0x3EE4F8B588E368F1>
  %v_22_ = fdiv <2 x double> %v_20_, %v_21_
  %v_23_.test = fcmp une <2 x double> %v_19_, <double 0x0000000000000000, double 0x0000000000000000>
  %v_23_ = select <2 x i1> %v_23_.test, <2 x double> <double 0x3EB0C6F7A0B5ED8D, double 0x3EB0C6F7A0B5ED8D>, <2 x double> %v_22_
  %v_24_.test = fcmp olt <2 x double> %v_23_, %largest_
  %v_24_ = select <2 x i1> %v_24_.test, <2 x double> %v_23_, <2 x double> %largest_
  %v_25_ = fmul <2 x double> %v_24_, %direction_
  %v_26_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %v_25_, <2 x double> %k_0_0_, <2 x double> %y_0_)
  %v_27_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %v_25_, <2 x double> %k_0_1_, <2 x double> %y_1_)
  %v_28_ = fadd <2 x double> %t_, %v_25_
  %out.0 = getelementptr double, ptr %out, i64 0
  store <2 x double> %v_26_, ptr %out.0, align 8
  %out.1 = getelementptr double, ptr %out, i64 2
  store <2 x double> %v_27_, ptr %out.1, align 8
  %out.2 = getelementptr double, ptr %out, i64 4
  store <2 x double> %v_28_, ptr %out.2, align 8
  ret void
}

define void @attempt_finish(ptr noalias nocapture %t, ptr noalias nocapture %y, ptr noalias nocapture %s, ptr noalias nocapture %k, ptr noalias nocapture %out) nounwind {
  %t_.at = getelementptr double, ptr %t, i64 0
  %t_ = load <2 x double>, ptr %t_.at, align 8
  %y_0_.at = getelementptr double, ptr %y, i64 0
  %y_0_ = load <2 x double>, ptr %y_0_.at, align 8
  %y_1_.at = getelementptr double, ptr %y, i64 2
  %y_1_ = load <2 x double>, ptr %y_1_.at, align 8
  %largest_.at = getelementptr double, ptr %s, i64 0
  %largest_ = load <2 x double>, ptr %largest_.at, align 8
  %direction_.at = getelementptr double, ptr %s, i64 2
  %direction_ = load <2 x double>, ptr %direction_.at, align 8
  %rtol_.at = getelementptr double, ptr %s, i64 4
  %rtol_ = load <2 x double>, ptr %rtol_.at, align 8
  %atol_.at = getelementptr double, ptr %s, i64 6
  %atol_ = load <2 x double>, ptr %atol_.at, align 8
  %proposal_.at = getelementptr double, ptr %y, i64 8
  %proposal_ = load <2 x double>, ptr %proposal_.at, align 8
  %previous_.at = getelementptr double, ptr %y, i64 10
  %previous_ = load <2 x double>, ptr %previous_.at, align 8
  %growth_.at = getelementptr double, ptr %y, i64 12
  %growth_ = load <2 x double>, ptr %growth_.at, align 8
  %k_0_0_.at = getelementptr double, ptr %k, i64 0
  %k_0_0_ = load <2 x double>, ptr %k_0_0_.at, align 8
  %k_0_1_.at = getelementptr double, ptr %k, i64 2
  %k_0_1_ = load <2 x double>, ptr %k_0_1_.at, align 8
  %k_1_0_.at = getelementptr double, ptr %k, i64 4
  %k_1_0_ = load <2 x double>, ptr %k_1_0_.at, align 8
  %k_1_1_.at = getelementptr double, ptr %k, i64 6
  %k_1_1_ = load <2 x double>, ptr %k_1_1_.at, align 8
  %k_2_0_.at = getelementptr double, ptr %k, i64 8
  %k_2_0_ = load <2 x double>, ptr %k_2_0_.at, align 8
  %k_2_1_.at = getelementptr double, ptr %k, i64 10
  %k_2_1_ = load <2 x double>, ptr %k_2_1_.at, align 8
  %k_3_0_.at = getelementptr double, ptr %k, i64 12
  %k_3_0_ = load <2 x double>, ptr %k_3_0_.at, align 8
  %k_3_1_.at = getelementptr double, ptr %k, i64 14
  %k_3_1_ = load <2 x double>, ptr %k_3_1_.at, align 8
  %k_4_0_.at = getelementptr double, ptr %k, i64 16
  %k_4_0_ = load <2 x double>, ptr %k_4_0_.at, align 8
  %k_4_1_.at = getelementptr double, ptr %k, i64 18
  %k_4_1_ = load <2 x double>, ptr %k_4_1_.at, align 8
  %k_5_0_.at = getelementptr double, ptr %k, i64 20
  %k_5_0_ = load <2 x double>, ptr %k_5_0_.at, align 8
  %k_5_1_.at = getelementptr double, ptr %k, i64 22
  %k_5_1_ = load <2 x double>, ptr %k_5_1_.at, align 8
  %k_6_0_.at = getelementptr double, ptr %k, i64 24
  %k_6_0_ = load <2 x double>, ptr %k_6_0_.at, align 8
  %k_6_1_.at = getelementptr double, ptr %k, i64 26
  %k_6_1_ = load <2 x double>, ptr %k_6_1_.at, align 8
  %v_0_ = call <2 x double> @llvm.fabs.v2f64(<2 x double> %t_)
  %v_1_ = fmul <2 x double> %v_0_, <double 0x3CF0000000000000, double 0x3CF0000000000000>
  %v_2_.test = fcmp ogt <2 x double> %proposal_, %v_1_
  %v_2_ = select <2 x i1> %v_2_.test, <2 x double> %proposal_, <2 x double> %v_1_
  %v_3_ = fmul <2 x double> %v_2_, <double 0x3FF000000044B830, double 0x3FF000000044B830>
  %v_4_.test = fcmp ole <2 x double> %largest_, %v_3_
  %v_4_ = select <2 x i1> %v_4_.test, <2 x double> <double 0x3FF0000000000000, double 0x3FF0000000000000>, <2 x double> <double 0x0000000000000000, double 0x0000000000000000>
  %v_5_.test = fcmp une <2 x double> %v_4_, <double 0x0000000000000000, double 0x0000000000000000>
  %v_5_ = select <2 x i1> %v_5_.test, <2 x double> %largest_, <2 x double> %v_2_
  %v_6_ = fmul <2 x double> %v_5_, %direction_
  %v_7_ = fmul <2 x double> %k_0_0_, <double 0x3FB8B1A71ED4A6EE, double 0x3FB8B1A71ED4A6EE>
  %v_8_ = fmul <2 x double> %k_0_1_, <double 0x3FB8B1A71ED4A6EE, double 0x3FB8B1A71ED4A6EE>
  %v_9_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_1_0_, <2 x double> <double 0x3F847AE147AE147B, double 0x3F847AE147AE147B>, <2 x double> %v_7_)
  %v_10_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_1_1_, <2 x double> <double 0x3F847AE147AE147B, double 0x3F847AE147AE147B>, <2 x double> %v_8_)
  %v_11_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_2_0_, <2 x double> <double 0x3FDEB683148E0688, double 0x3FDEB683148E0688>, <2 x double> %v_9_)
  %v_12_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_2_1_, <2 x double> <double 0x3FDEB683148E0688, double 0x3FDEB683148E0688>, <2 x double> %v_10_)
  %v_13_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_3_0_, <2 x double> <double 0x3FF6106B4B6ADDDB, double 0x3FF6106B4B6ADDDB>, <2 x double> %v_11_)
  %v_14_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_3_1_, <2 x double> <double 0x3FF6106B4B6ADDDB, double 0x3FF6106B4B6ADDDB>, <2 x double> %v_12_)
  %v_15_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_4_0_, <2 x double> <double 0xC00A520FF752EA91, double 0xC00A520FF752EA91>, <2 x double> %v_13_)
  %v_16_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_4_1_, <2 x double> <double 0xC00A520FF752EA91, double 0xC00A520FF752EA91>, <2 x double> %v_14_)
  %v_17_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_5_0_, <2 x double> <double 0x40029901D4CD6786, double 0x40029901D4CD6786>, <2 x double> %v_15_)
  %v_18_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_5_1_, <2 x double> <double 0x40029901D4CD6786, double 0x40029901D4CD6786>, <2 x double> %v_16_)
  %v_19_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %v_6_, <2 x double> %v_17_, <2 x double> %y_0_)
  %v_20_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %v_6_, <2 x double> %v_18_, <2 x double> %y_1_)
  %v_21_ = fmul <2 x double> %k_0_0_, <double 0xBF5D29E8505F7D7F, double 0xBF5D29E8505F7D7F>
  %v_22_ = fmul <2 x double> %k_0_1_, <double 0xBF5D29E8505F7D7F, double 0xBF5D29E8505F7D7F>
  %v_23_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_1_0_, <2 x double> <double 0xBF4AC0BFA6DAD476, double 0xBF4AC0BFA6DAD476>, <2 x double> %v_21_)
  %v_24_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_1_1_, <2 x double> <double 0xBF4AC0BFA6DAD476, double 0xBF4AC0BFA6DAD476>, <2 x double> %v_22_)
  %v_25_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_2_0_, <2 x double> <double 0x3F8023D98A8AF021, double 0x3F8023D98A8AF021>, <2 x double> %v_23_)
  %v_26_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_2_1_, <2 x double> <double 0x3F8023D98A8AF021, double 0x3F8023D98A8AF021>, <2 x double> %v_24_)
  %v_27_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_3_0_, <2 x double> <double 0xBFC285E3E99716E0, double 0xBFC285E3E99716E0>, <2 x double> %v_25_)
  %v_28_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_3_1_, <2 x double> <double 0xBFC285E3E99716E0, double 0xBFC285E3E99716E0>, <2 x double> %v_26_)
  %v_29_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_4_0_, <2 x double> <double 0x3FE2A2AB7E86B834, double 0x3FE2A2AB7E86B834>, <2 x double> %v_27_)
  %v_30_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_4_1_, <2 x double> <double 0x3FE2A2AB7E86B834, double 0x3FE2A2AB7E86B834>, <2 x double> %v_28_)
  %v_31_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_5_0_, <2 x double> <double 0xBFDD51379BF6508A, double 0xBFDD51379BF6508A>, <2 x double> %v_29_)
  %v_32_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_5_1_, <2 x double> <double 0xBFDD51379BF6508A, double 0xBFDD51379BF6508A>, <2 x double> %v_30_)
  %v_33_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_6_0_, <2 x double> <double 0x3F8F07C1F07C1F08, double 0x3F8F07C1F07C1F08>, <2 x double> %v_31_)
  %v_34_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %k_6_1_, <2 x double> <double 0x3F8F07C1F07C1F08, double 0x3F8F07C1F07C1F08>, <2 x double> %v_32_)
  %v_35_ = call <2 x double> @llvm.fabs.v2f64(<2 x double> %y_0_)
  %v_36_ = call <2 x double> @llvm.fabs.v2f64(<2 x double> %v_19_)
  %v_37_.test = fcmp ogt <2 x double> %v_35_, %v_36_
  %v_37_ = select <2 x i1> %v_37_.test, <2 x double> %v_35_, <2 x double> %v_36_
  %v_38_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %rtol_, <2 x double> %v_37_, <2 x double> %atol_)
  %v_39_ = fdiv <2 x double> <double 0x3FF0000000000000, double 0x3FF0000000000000>, %v_38_
  %v_40_ = fmul <2 x double> %v_33_, %v_39_
  %v_41_ = fmul <2 x double> %v_40_, %v_40_
  %v_42_ = call <2 x double> @llvm.fabs.v2f64(<2 x double> %y_1_)
  %v_43_ = call <2 x double> @llvm.fabs.v2f64(<2 x double> %v_20_)
  %v_44_.test = fcmp ogt <2 x double> %v_42_, %v_43_
  %v_44_ = select <2 x i1> %v_44_.test, <2 x double> %v_42_, <2 x double> %v_43_
  %v_45_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %rtol_, <2 x double> %v_44_, <2 x double> %atol_)
  %v_46_ = fdiv <2 x double> <double 0x3FF0000000000000, double 0x3FF0000000000000>, %v_45_
  %v_47_ = fmul <2 x double> %v_34_, %v_46_
  %v_48_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %v_47_, <2 x double> %v_47_, <2 x double> %v_41_)
  %v_49_ = fmul <2 x double> %v_5_, %v_5_
  %v_50_ = fmul <2 x double> %v_49_, <double 0x3FE0000000000000, double 0x3FE0000000000000>
  %v_51_ = fmul <2 x double> %v_48_, %v_50_
  %v_52_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %v_19_, <2 x double> <double 0x0000000000000000, double 0x0000000000000000>, <2 x double> %v_51_)
  %v_53_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %v_20_, <2 x double> <double 0x0000000000000000, double 0x0000000000000000>, <2 x double> %v_52_)
  %v_54_.test = fcmp ole <2 x double> %v_53_, <double 0x3FF0000000000000, double 0x3FF0000000000000>
  %v_54_ = select <2 x i1> %v_54_.test, <2 x double> <double 0x3FF0000000000000, double 0x3FF0000000000000>, <2 x double> <double 0x0000000000000000, double 0x0000000000000000>
  %v_55_.test = fcmp ole <2 x double> %v_53_, <double 0x7FEFFFFFFFFFFFFF, double 0x7FEFFFFFFFFFFFFF>
  %v_55_ = select <2 x i1> %v_55_.test, <2 x double> <double 0x3FF0000000000000, double 0x3FF0000000000000>, <2 x double> <double 0x0000000000000000, double 0x0000000000000000>
  %v_56_ = call <2 x double> @rough_log2(<2 x double> %v_53_)
  %v_57_ = fmul <2 x double> %v_56_, <double 0x3FE0000000000000, double 0x3FE0000000000000>
  %v_58_ = fmul <2 x double> %previous_, <double 0x3FA47AE147AE147C, double 0x3FA47AE147AE147C>
  %v_59_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %v_57_, <2 x double> <double 0xBFC5C28F5C28F5C3, double 0xBFC5C28F5C28F5C3>, <2 x double> %v_58_)
  %v_60_ = fmul <2 x double> %v_57_, <double 0xBFC999999999999A, double 0xBFC999999999999A>
  %v_61_.test = fcmp une <2 x double> %v_54_, <double 0x0000000000000000, double 0x0000000000000000>
  %v_61_ = select <2 x i1> %v_61_.test, <2 x double> %v_59_, <2 x double> %v_60_
  %v_62_ = call <2 x double> @rough_exp2(<2 x double> %v_61_)
  %v_63_ = fmul <2 x double> %v_62_, <double 0x3FECCCCCCCCCCCCD, double 0x3FECCCCCCCCCCCCD>
  %v_64_.test = fcmp olt <2 x double> %v_63_, %growth_
  %v_64_ = select <2 x i1> %v_64_.test, <2 x double> %v_63_, <2 x double> %growth_
  %v_65_.test = fcmp ogt <2 x double> %v_64_, <double 0x3FC999999999999A, double 0x3FC999999999999A>
  %v_65_ = select <2 x i1> %v_65_.test, <2 x double> %v_64_, <2 x double> <double 0x3FC999999999999A, double 0x3FC999999999999A>
  %v_66_.test = fcmp une <2 x double> %v_55_, <double 0x0000000000000000, double 0x0000000000000000>
  %v_66_ = select <2 x i1> %v_66_.test, <2 x double> %v_65_, <2 x double> <double 0x3FB999999999999A, double 0x3FB999999999999A>
  %v_67_ = fmul <2 x double> %v_5_, %v_66_
  %v_68_.test = fcmp ogt <2 x double> %v_57_, <double 0xC02A934F0979A371, double 0xC02A934F0979A371>
  %v_68_ = select <2 x i1> %v_68_.test, <2 x double> %v_57_, <2 x double> <double 0xC02A934F0979A371, double 0xC02A934F0979A371>
  %v_69_.test = fcmp une <2 x double> %v_54_, <double 0x0000000000000000, double 0x0000000000000000>
  %v_69_ = select <2 x i1> %v_69_.test, <2 x double> %v_68_, <2 x double> %previous_
  %v_70_.test = fcmp une <2 x double> %v_54_, <double 0x0000000000000000, double 0x0000000000000000>
  %v_70_ = select <2 x i1> %v_70_.test, <2 x double> <double 0x4020000000000000, double 0x4020000000000000>, <2 x double> <double 0x3FF0000000000000, double 0x3FF0000000000000>
  %v_71_.test = fcmp une <2 x double> %v_54_, <double 0x0000000000000000, double 0x0000000000000000>
  %v_71_ = select <2 x i1> %v_71_.test, <2 x double> %v_19_, <2 x double> %y_0_
  %v_72_.test = fcmp une <2 x double> %v_54_, <double 0x0000000000000000, double 0x0000000000000000>
  %v_72_ = select <2 x i1> %v_72_.test, <2 x double> %v_20_, <2 x double> %y_1_
  %v_73_.test = fcmp une <2 x double> %v_54_, <double 0x0000000000000000, double 0x0000000000000000>
  %v_73_ = select <2 x i1> %v_73_.test, <2 x double> %v_5_, <2 x double> <double 0x0000000000000000, double 0x0000000000000000>
  %v_74_.test = fcmp une <2 x double> %v_55_, <double 0x0000000000000000, double 0x0000000000000000>
  %v_74_ = select <2 x i1> %v_74_.test, <2 x double> <double 0x0000000000000000, double 0x0000000000000000>, <2 x double> <double 0x3FF0000000000000, double 0x3FF0000000000000>
  %out.0 = getelementptr double, ptr %out, i64 0
  store <2 x double> %v_71_, ptr %out.0, align 8
  %out.1 = getelementptr double, ptr %out, i64 2
  store <2 x double> %v_72_, ptr %out.1, align 8
  %out.2 = getelementptr double, ptr %out, i64 4
  store <2 x double> %v_73_, ptr %out.2, align 8
  %out.3 = getelementptr double, ptr %out, i64 6
  store <2 x double> %v_74_, ptr %out.3, align 8
  %out.4 = getelementptr double, ptr %out, i64 8
  store <2 x double> %v_67_, ptr %out.4, align 8
  %out.5 = getelementptr double, ptr %out, i64 10
  store <2 x double> %v_69_, ptr %out.5, align 8
  %out.6 = getelementptr double, ptr %out, i64 12
  store <2 x double> %v_70_, ptr %out.6, align 8
  ret void
}

define void @start_finish(ptr noalias nocapture %t, ptr noalias nocapture %y, ptr noalias nocapture %s, ptr noalias nocapture %k, ptr noalias nocapture %out) nounwind {
  %y_0_.at = getelementptr double, ptr %y, i64 0
  %y_0_ = load <2 x double>, ptr %y_0_.at, align 8
  %y_1_.at = getelementptr double, ptr %y, i64 2
  %y_1_ = load <2 x double>, ptr %y_1_.at, align 8
  %largest_.at = getelementptr double, ptr %s, i64 0
  %largest_ = load <2 x double>, ptr %largest_.at, align 8
  %rtol_.at = getelementptr double, ptr %s, i64 4
  %rtol_ = load <2 x double>, ptr %rtol_.at, align 8
  %atol_.at = getelementptr double, ptr %s, i64 6
  %atol_ = load <2 x double>, ptr %atol_.at, align 8
  %k_0_0_.at = getelementptr double, ptr %k, i64 0
  %k_0_0_ = load <2 x double>, ptr %k_0_0_.at, align 8
  %k_0_1_.at = getelementptr double, ptr %k, i64 2
  %k_0_1_ = load <2 x double>, ptr %k_0_1_.at, align 8
  %k_1_0_.at = getelementptr double, ptr %k, i64 4
  %k_1_0_ = load <2 x double>, ptr %k_1_0_.at, align 8
  %k_1_1_.at = getelementptr double, ptr %k, i64 6
  %k_1_1_ = load <2 x double>, ptr %k_1_1_.at, align 8
  %v_0_ = call <2 x double> @llvm.fabs.v2f64(<2 x double> %y_0_)
  %v_1_ = call <2 x double> @llvm.fabs.v2f64(<2 x double> %y_1_)
  %v_2_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %rtol_, <2 x double> %v_0_, <2 x double> %atol_)
  %v_3_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %rtol_, <2 x double> %v_1_, <2 x double> %atol_)
  %v_4_ = fdiv <2 x double> <double 0x3FF0000000000000, double 0x3FF0000000000000>, %v_2_
  %v_5_ = fdiv <2 x double> <double 0x3FF0000000000000, double 0x3FF0000000000000>, %v_3_
  %v_6_ = fmul <2 x double> %y_0_, %v_4_
  %v_7_ = fmul <2 x double> %v_6_, %v_6_
  %v_8_ = fmul <2 x double> %y_1_, %v_5_
  %v_9_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %v_8_, <2 x double> %v_8_, <2 x double> %v_7_)
  %v_10_ = fmul <2 x double> %v_9_, <double 0x3FE0000000000000, double 0x3FE0000000000000>
  %v_11_ = call <2 x double> @llvm.sqrt.v2f64(<2 x double> %v_10_)
  %v_12_ = fmul <2 x double> %k_0_0_, %v_4_
  %v_13_ = fmul <2 x double> %v_12_, %v_12_
  %v_14_ = fmul <2 x double> %k_0_1_, %v_5_
  %v_15_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %v_14_, <2 x double> %v_14_, <2 x double> %v_13_)
  %v_16_ = fmul <2 x double> %v_15_, <double 0x3FE0000000000000, double 0x3FE0000000000000>
  %v_17_ = call <2 x double> @llvm.sqrt.v2f64(<2 x double> %v_16_)
  %v_18_.test = fcmp olt <2 x double> %v_11_, %v_17_
  %v_18_ = select <2 x i1> %v_18_.test, <2 x double> %v_11_, <2 x double> %v_17_
  %v_19_.test = fcmp olt <2 x double> %v_18_, <double 0x3EE4F8B588E368F1, double 0x3EE4F8B588E368F1>
  %v_19_ = select <2 x i1> %v_19_.test, <2 x double> <double 0x3FF0000000000000, double 0x3FF0000000000000>, <2 x double> <double 0x0000000000000000, double 0x0000000000000000>
  %v_20_ = fmul <2 x double> %v_11_, <double 0x3F847AE147AE147B, double 0x3F847AE147AE147B>
  %v_21_.test = fcmp ogt <2 x double> %v_17_, <double 0x3EE4F8B588E368F1, double 0x3EE4F8B588E368F1>
  %v_21_ = select <2 x i1> %v_21_.test, <2 x double> %v_17_, <2 x double> <double 0x3EE4F8B588E368F1, double 0x3EE4F8B588E368F1>
  %v_22_ = fdiv <2 x double> %v_20_, %v_21_
  %v_23_.test = fcmp une <2 x double> %v_19_, <double 0x0000000000000000, double 0x0000000000000000>
  %v_23_ = select <2 x i1> %v_23_.test, <2 x double> <double 0x3EB0C6F7A0B5ED8D, double 0x3EB0C6F7A0B5ED8D>, <2 x double> %v_22_
  %v_24_.test = fcmp olt <2 x double> %v_23_, %largest_
  %v_24_ = select <2 x i1> %v_24_.test, <2 x double> %v_23_, <2 x double> %largest_
  %v_25_ = fsub <2 x double> %k_1_0_, %k_0_0_
  %v_26_ = fsub <2 x double> %k_1_1_, %k_0_1_
  %v_27_ = fmul <2 x double> %v_25_, %v_4_
  %v_28_ = fmul <2 x double> %v_27_, %v_27_
  %v_29_ = fmul <2 x double> %v_26_, %v_5_
  %v_30_ = call <2 x double> @llvm.fma.v2f64(<2 x double> %v_29_, <2 x double> %v_29_, <2 x double> %v_28_)
  %v_31_ = fmul <2 x double> %v_30_, <double 0x3FE0000000000000, double 0x3FE0000000000000>
  %v_32_ = call <2 x double> @llvm.sqrt.v2f64(<2 x double> %v_31_)
  %v_33_ = fdiv <2 x double> %v_32_, %v_24_
  %v_34_.test = fcmp ogt <2 x double> %v_17_, %v_33_
  %v_34_ = select <2 x i1> %v_34_.test, <2 x double> %v_17_, <2 x double> %v_33_
  %v_35_.test = fcmp ogt <2 x double> %v_34_, <double 0x3CD203AF9EE75616, double 0x3CD203AF9EE75616>
  %v_35_ = select <2 x i1> %v_35_.test, <2 x double> %v_34_, <2 x double> <double 0x3CD203AF9EE75616, double 0x3CD203AF9EE75616>
  %v_36_ = call <2 x double> @rough_log2(<2 x double> %v_35_)
  %v_37_ = fsub <2 x double> <double 0xC01A934F0979A371, double 0xC01A934F0979A371>, %v_36_
  %v_38_ = fmul <2 x double> %v_37_, <double 0x3FC999999999999A, double 0x3FC999999999999A>
  %v_39_ = fmul <2 x double> %v_24_, <double 0x4059000000000000, double 0x4059000000000000>
  %v_40_ = call <2 x double> @rough_exp2(<2 x double> %v_38_)
  %v_41_.test = fcmp olt <2 x double> %v_39_, %v_40_
  %v_41_ = select <2 x i1> %v_41_.test, <2 x double> %v_39_, <2 x double> %v_40_
  %v_42_.test = fcmp ole <2 x double> %v_33_, <double 0x7FEFFFFFFFFFFFFF, double 0x7FEFFFFFFFFFFFFF>
  %v_42_ = select <2 x i1> %v_42_.test, <2 x double> <double 0x3FF0000000000000, double 0x3FF0000000000000>, <2 x double> <double 0x0000000000000000, double 0x0000000000000000>
  %v_43_.test = fcmp olt <2 x double> %v_41_, %largest_
  %v_43_ = select <2 x i1> %v_43_.test, <2 x double> %v_41_, <2 x double> %largest_
  %v_44_.test = fcmp une <2 x double> %v_42_, <double 0x0000000000000000, double 0x0000000000000000>
  %v_44_ = select <2 x i1> %v_44_.test, <2 x double> %v_43_, <2 x double> %v_24_
  %v_45_.test = fcmp ole <2 x double> %v_17_, <double 0x7FEFFFFFFFFFFFFF, double 0x7FEFFFFFFFFFFFFF>
  %v_45_ = select <2 x i1> %v_45_.test, <2 x double> <double 0x3FF0000000000000, double 0x3FF0000000000000>, <2 x double> <double 0x0000000000000000, double 0x0000000000000000>
  %v_46_.test = fcmp une <2 x double> %v_45_, <double 0x0000000000000000, double 0x0000000000000000>
  %v_46_ = select <2 x i1> %v_46_.test, <2 x double> %v_44_, <2 x double> <double 0x0000000000000000, double 0x0000000000000000>
  %out.0 = getelementptr double, ptr %out, i64 0
  store <2 x double> %y_0_, ptr %out.0, align 8
  %out.1 = getelementptr double, ptr %out, i64 2
  store <2 x double> %y_1_, ptr %out.1, align 8
  %out.2 = getelementptr double, ptr %out, i64 4
  store <2 x double> <double 0x0000000000000000, double 0x0000000000000000>, ptr %out.2, align 8
  %out.3 = getelementptr double, ptr %out, i64 6
  store <2 x double> <double 0x0000000000000000, double 0x0000000000000000>, ptr %out.3, align 8
  %out.4 = getelementptr double, ptr %out, i64 8
  store <2 x double> %v_46_, ptr %out.4, align 8
  %out.5 = getelementptr double, ptr %out, i64 10
  store <2 x double> <double 0xC02A934F0979A371, double 0xC02A934F0979A371>, ptr %out.5, align 8
  %out.6 = getelementptr double, ptr %out, i64 12
  store <2 x double> <double 0x4020000000000000, double 0x4020000000000000>, ptr %out.6, align 8
  ret void
}

; Slopes of the stages, and the points where they are evaluated, lie on the stack.
define void @attempt(ptr noalias nocapture %t, ptr noalias nocapture %y, ptr noalias nocapture %c, ptr noalias nocapture %s, ptr noalias nocapture %out) nounwind {
  %k = alloca [14 x <2 x double>], align 64
  %point = alloca [3 x <2 x double>], align 64
  %clock = getelementptr <2 x double>, ptr %point, i64 2
  call void @attempt_stage0(ptr %t, ptr %y, ptr %s, ptr %k, ptr %point)
  %slope.0 = getelementptr <2 x double>, ptr %k, i64 0
  call void @rhs(ptr %clock, ptr %point, ptr %c, ptr %slope.0)
  call void @attempt_stage1(ptr %t, ptr %y, ptr %s, ptr %k, ptr %point)
  %slope.1 = getelementptr <2 x double>, ptr %k, i64 2
  call void @rhs(ptr %clock, ptr %point, ptr %c, ptr %slope.1)
  call void @attempt_stage2(ptr %t, ptr %y, ptr %s, ptr %k, ptr %point)
  %slope.2 = getelementptr <2 x double>, ptr %k, i64 4
  call void @rhs(ptr %clock, ptr %point, ptr %c, ptr %slope.2)
  call void @attempt_stage3(ptr %t, ptr %y, ptr %s, ptr %k, ptr %point)
  %slope.3 = getelementptr <2 x double>, ptr %k, i64 6
  call void @rhs(ptr %clock, ptr %point, ptr %c, ptr %slope.3)
  call void @attempt_stage4(ptr %t, ptr %y, ptr %s, ptr %k, ptr %point)
  %slope.4 = getelementptr <2 x double>, ptr %k, i64 8
  call void @rhs(ptr %clock, ptr %point, ptr %c, ptr %slope.4)
  call void @attempt_stage5(ptr %t, ptr %y, ptr %s, ptr %k, ptr %point)
  %slope.5 = getelementptr <2 x double>, ptr %k, i64 10
  call void @rhs(ptr %clock, ptr %point, ptr %c, ptr %slope.5)
  call void @attempt_stage6(ptr %t, ptr %y, ptr %s, ptr %k, ptr %point)
  %slope.6 = getelementptr <2 x double>, ptr %k, i64 12
  call void @rhs(ptr %clock, ptr %point, ptr %c, ptr %slope.6)
  call void @attempt_finish(ptr %t, ptr %y, ptr %s, ptr %k, ptr %out)
  ret void
}

; Slopes of the stages, and the points where they are evaluated, lie on the stack.
define void @start(ptr noalias nocapture %t, ptr noalias nocapture %y, ptr noalias nocapture %c, ptr noalias nocapture %s, ptr noalias nocapture %out) nounwind {
  %k = alloca [4 x <2 x double>], align 64
  %point = alloca [3 x <2 x double>], align 64
  %clock = getelementptr <2 x double>, ptr %point, i64 2
  call void @start_stage0(ptr %t, ptr %y, ptr %s, ptr %k, ptr %point)
  %slope.0 = getelementptr <2 x double>, ptr %k, i64 0
  call void @rhs(ptr %clock, ptr %point, ptr %c, ptr %slope.0)
  call void @start_stage1(ptr %t, ptr %y, ptr %s, ptr %k, ptr %point)
  %slope.1 = getelementptr <2 x double>, ptr %k, i64 2
  call void @rhs(ptr %clock, ptr %point, ptr %c, ptr %slope.1)
  call void @start_finish(ptr %t, ptr %y, ptr %s, ptr %k, ptr %out)
  ret void
}
