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

define internal <2 x double> @sin_repeating(<2 x double> %x) nounwind {
entry:
  %x0 = extractelement <2 x double> %x, i32 0
  %bits0 = bitcast double %x0 to i64
  %y0 = call double @sin(double %x0)
  %x1 = extractelement <2 x double> %x, i32 1
  %bits1 = bitcast double %x1 to i64
  %same1 = icmp eq i64 %bits1, %bits0
  br i1 %same1, label %known1, label %new1
new1:
  %value1 = call double @sin(double %x1)
  br label %known1
known1:
  %y1 = phi double [%y0, %entry], [%value1, %new1]
  %pack0 = insertelement <2 x double> undef, double %y0, i32 0
  %pack1 = insertelement <2 x double> %pack0, double %y1, i32 1
  ret <2 x double> %pack1
}

define internal <2 x double> @cos_repeating(<2 x double> %x) nounwind {
entry:
  %x0 = extractelement <2 x double> %x, i32 0
  %bits0 = bitcast double %x0 to i64
  %y0 = call double @cos(double %x0)
  %x1 = extractelement <2 x double> %x, i32 1
  %bits1 = bitcast double %x1 to i64
  %same1 = icmp eq i64 %bits1, %bits0
  br i1 %same1, label %known1, label %new1
new1:
  %value1 = call double @cos(double %x1)
  br label %known1
known1:
  %y1 = phi double [%y0, %entry], [%value1, %new1]
  %pack0 = insertelement <2 x double> undef, double %y0, i32 0
  %pack1 = insertelement <2 x double> %pack0, double %y1, i32 1
  ret <2 x double> %pack1
}

define internal <2 x double> @tan_repeating(<2 x double> %x) nounwind {
entry:
  %x0 = extractelement <2 x double> %x, i32 0
  %bits0 = bitcast double %x0 to i64
  %y0 = call double @tan(double %x0)
  %x1 = extractelement <2 x double> %x, i32 1
  %bits1 = bitcast double %x1 to i64
  %same1 = icmp eq i64 %bits1, %bits0
  br i1 %same1, label %known1, label %new1
new1:
  %value1 = call double @tan(double %x1)
  br label %known1
known1:
  %y1 = phi double [%y0, %entry], [%value1, %new1]
  %pack0 = insertelement <2 x double> undef, double %y0, i32 0
  %pack1 = insertelement <2 x double> %pack0, double %y1, i32 1
  ret <2 x double> %pack1
}

define internal <2 x double> @asin_repeating(<2 x double> %x) nounwind {
entry:
  %x0 = extractelement <2 x double> %x, i32 0
  %bits0 = bitcast double %x0 to i64
  %y0 = call double @asin(double %x0)
  %x1 = extractelement <2 x double> %x, i32 1
  %bits1 = bitcast double %x1 to i64
  %same1 = icmp eq i64 %bits1, %bits0
  br i1 %same1, label %known1, label %new1
new1:
  %value1 = call double @asin(double %x1)
  br label %known1
known1:
  %y1 = phi double [%y0, %entry], [%value1, %new1]
  %pack0 = insertelement <2 x double> undef, double %y0, i32 0
  %pack1 = insertelement <2 x double> %pack0, double %y1, i32 1
  ret <2 x double> %pack1
}

define internal <2 x double> @acos_repeating(<2 x double> %x) nounwind {
entry:
  %x0 = extractelement <2 x double> %x, i32 0
  %bits0 = bitcast double %x0 to i64
  %y0 = call double @acos(double %x0)
  %x1 = extractelement <2 x double> %x, i32 1
  %bits1 = bitcast double %x1 to i64
  %same1 = icmp eq i64 %bits1, %bits0
  br i1 %same1, label %known1, label %new1
new1:
  %value1 = call double @acos(double %x1)
  br label %known1
known1:
  %y1 = phi double [%y0, %entry], [%value1, %new1]
  %pack0 = insertelement <2 x double> undef, double %y0, i32 0
  %pack1 = insertelement <2 x double> %pack0, double %y1, i32 1
  ret <2 x double> %pack1
}

define internal <2 x double> @atan_repeating(<2 x double> %x) nounwind {
entry:
  %x0 = extractelement <2 x double> %x, i32 0
  %bits0 = bitcast double %x0 to i64
  %y0 = call double @atan(double %x0)
  %x1 = extractelement <2 x double> %x, i32 1
  %bits1 = bitcast double %x1 to i64
  %same1 = icmp eq i64 %bits1, %bits0
  br i1 %same1, label %known1, label %new1
new1:
  %value1 = call double @atan(double %x1)
  br label %known1
known1:
  %y1 = phi double [%y0, %entry], [%value1, %new1]
  %pack0 = insertelement <2 x double> undef, double %y0, i32 0
  %pack1 = insertelement <2 x double> %pack0, double %y1, i32 1
  ret <2 x double> %pack1
}

define internal <2 x double> @exp_repeating(<2 x double> %x) nounwind {
entry:
  %x0 = extractelement <2 x double> %x, i32 0
  %bits0 = bitcast double %x0 to i64
  %y0 = call double @exp(double %x0)
  %x1 = extractelement <2 x double> %x, i32 1
  %bits1 = bitcast double %x1 to i64
  %same1 = icmp eq i64 %bits1, %bits0
  br i1 %same1, label %known1, label %new1
new1:
  %value1 = call double @exp(double %x1)
  br label %known1
known1:
  %y1 = phi double [%y0, %entry], [%value1, %new1]
  %pack0 = insertelement <2 x double> undef, double %y0, i32 0
  %pack1 = insertelement <2 x double> %pack0, double %y1, i32 1
  ret <2 x double> %pack1
}

define internal <2 x double> @log_repeating(<2 x double> %x) nounwind {
entry:
  %x0 = extractelement <2 x double> %x, i32 0
  %bits0 = bitcast double %x0 to i64
  %y0 = call double @log(double %x0)
  %x1 = extractelement <2 x double> %x, i32 1
  %bits1 = bitcast double %x1 to i64
  %same1 = icmp eq i64 %bits1, %bits0
  br i1 %same1, label %known1, label %new1
new1:
  %value1 = call double @log(double %x1)
  br label %known1
known1:
  %y1 = phi double [%y0, %entry], [%value1, %new1]
  %pack0 = insertelement <2 x double> undef, double %y0, i32 0
  %pack1 = insertelement <2 x double> %pack0, double %y1, i32 1
  ret <2 x double> %pack1
}

define internal <2 x double> @sinh_repeating(<2 x double> %x) nounwind {
entry:
  %x0 = extractelement <2 x double> %x, i32 0
  %bits0 = bitcast double %x0 to i64
  %y0 = call double @sinh(double %x0)
  %x1 = extractelement <2 x double> %x, i32 1
  %bits1 = bitcast double %x1 to i64
  %same1 = icmp eq i64 %bits1, %bits0
  br i1 %same1, label %known1, label %new1
new1:
  %value1 = call double @sinh(double %x1)
  br label %known1
known1:
  %y1 = phi double [%y0, %entry], [%value1, %new1]
  %pack0 = insertelement <2 x double> undef, double %y0, i32 0
  %pack1 = insertelement <2 x double> %pack0, double %y1, i32 1
  ret <2 x double> %pack1
}

define internal <2 x double> @cosh_repeating(<2 x double> %x) nounwind {
entry:
  %x0 = extractelement <2 x double> %x, i32 0
  %bits0 = bitcast double %x0 to i64
  %y0 = call double @cosh(double %x0)
  %x1 = extractelement <2 x double> %x, i32 1
  %bits1 = bitcast double %x1 to i64
  %same1 = icmp eq i64 %bits1, %bits0
  br i1 %same1, label %known1, label %new1
new1:
  %value1 = call double @cosh(double %x1)
  br label %known1
known1:
  %y1 = phi double [%y0, %entry], [%value1, %new1]
  %pack0 = insertelement <2 x double> undef, double %y0, i32 0
  %pack1 = insertelement <2 x double> %pack0, double %y1, i32 1
  ret <2 x double> %pack1
}

define internal <2 x double> @tanh_repeating(<2 x double> %x) nounwind {
entry:
  %x0 = extractelement <2 x double> %x, i32 0
  %bits0 = bitcast double %x0 to i64
  %y0 = call double @tanh(double %x0)
  %x1 = extractelement <2 x double> %x, i32 1
  %bits1 = bitcast double %x1 to i64
  %same1 = icmp eq i64 %bits1, %bits0
  br i1 %same1, label %known1, label %new1
new1:
  %value1 = call double @tanh(double %x1)
  br label %known1
known1:
  %y1 = phi double [%y0, %entry], [%value1, %new1]
  %pack0 = insertelement <2 x double> undef, double %y0, i32 0
  %pack1 = insertelement <2 x double> %pack0, double %y1, i32 1
  ret <2 x double> %pack1
}

define void @prepare(ptr noalias nocapture %p, ptr noalias nocapture %out) nounwind {
  ret void
}

define void @outputs(ptr noalias nocapture %t, ptr noalias nocapture %y, ptr noalias nocapture %c, ptr noalias nocapture %out) nounwind {
  %t_2.at = getelementptr double, ptr %t, i64 0
  %t_2 = load <2 x double>, ptr %t_2.at, align 8
  %a.at = getelementptr double, ptr %y, i64 0
  %a = load <2 x double>, ptr %a.at, align 8
  %b.at = getelementptr double, ptr %y, i64 2
  %b = load <2 x double>, ptr %b.at, align 8
  %z_add = fadd <2 x double> %a, %b
  %z_sub = fsub <2 x double> %a, %b
  %z_mul = fmul <2 x double> %a, %b
  %z_div = fdiv <2 x double> %a, %b
  %z_neg = fneg <2 x double> %a
  %z_sqrt = call <2 x double> @llvm.sqrt.v2f64(<2 x double> %a)
  %z_pow.0.0 = extractelement <2 x double> %a, i32 0
  %z_pow.0.1 = extractelement <2 x double> %b, i32 0
  %z_pow.0 = call double @pow(double %z_pow.0.0, double %z_pow.0.1)
  %z_pow.pack0 = insertelement <2 x double> undef, double %z_pow.0, i32 0
  %z_pow.1.0 = extractelement <2 x double> %a, i32 1
  %z_pow.1.1 = extractelement <2 x double> %b, i32 1
  %z_pow.1 = call double @pow(double %z_pow.1.0, double %z_pow.1.1)
  %z_pow = insertelement <2 x double> %z_pow.pack0, double %z_pow.1, i32 1
  %z_sin = call <2 x double> @sin_repeating(<2 x double> %a)
  %z_cos = call <2 x double> @cos_repeating(<2 x double> %a)
  %z_tan = call <2 x double> @tan_repeating(<2 x double> %a)
  %z_asin = call <2 x double> @asin_repeating(<2 x double> %a)
  %z_acos = call <2 x double> @acos_repeating(<2 x double> %a)
  %z_atan = call <2 x double> @atan_repeating(<2 x double> %a)
  %z_atan2.0.0 = extractelement <2 x double> %a, i32 0
  %z_atan2.0.1 = extractelement <2 x double> %b, i32 0
  %z_atan2.0 = call double @atan2(double %z_atan2.0.0, double %z_atan2.0.1)
  %z_atan2.pack0 = insertelement <2 x double> undef, double %z_atan2.0, i32 0
  %z_atan2.1.0 = extractelement <2 x double> %a, i32 1
  %z_atan2.1.1 = extractelement <2 x double> %b, i32 1
  %z_atan2.1 = call double @atan2(double %z_atan2.1.0, double %z_atan2.1.1)
  %z_atan2 = insertelement <2 x double> %z_atan2.pack0, double %z_atan2.1, i32 1
  %z_exp = call <2 x double> @exp_repeating(<2 x double> %a)
  %z_log = call <2 x double> @log_repeating(<2 x double> %a)
  %z_sinh = call <2 x double> @sinh_repeating(<2 x double> %a)
  %z_cosh = call <2 x double> @cosh_repeating(<2 x double> %a)
  %z_tanh = call <2 x double> @tanh_repeating(<2 x double> %a)
  %z_abs = call <2 x double> @llvm.fabs.v2f64(<2 x double> %a)
  %z_sign.up.test = fcmp ogt <2 x double> %a, <double 0x0000000000000000, double 0x0000000000000000>
  %z_sign.up = select <2 x i1> %z_sign.up.test, <2 x double> <double 0x3FF0000000000000, double 0x3FF0000000000000>, <2 x double> <double 0x0000000000000000, double 0x0000000000000000>
  %z_sign.test = fcmp olt <2 x double> %a, <double 0x0000000000000000, double 0x0000000000000000>
  %z_sign = select <2 x i1> %z_sign.test, <2 x double> <double 0xBFF0000000000000, double 0xBFF0000000000000>, <2 x double> %z_sign.up
  %z_floor = call <2 x double> @llvm.floor.v2f64(<2 x double> %a)
  %z_min.test = fcmp olt <2 x double> %a, %b
  %z_min = select <2 x i1> %z_min.test, <2 x double> %a, <2 x double> %b
  %z_max.test = fcmp ogt <2 x double> %a, %b
  %z_max = select <2 x i1> %z_max.test, <2 x double> %a, <2 x double> %b
  %z_less.test = fcmp olt <2 x double> %a, %b
  %z_less = select <2 x i1> %z_less.test, <2 x double> <double 0x3FF0000000000000, double 0x3FF0000000000000>, <2 x double> <double 0x0000000000000000, double 0x0000000000000000>
  %z_less_equal.test = fcmp ole <2 x double> %a, %b
  %z_less_equal = select <2 x i1> %z_less_equal.test, <2 x double> <double 0x3FF0000000000000, double 0x3FF0000000000000>, <2 x double> <double 0x0000000000000000, double 0x0000000000000000>
  %z_select.test = fcmp une <2 x double> %a, <double 0x0000000000000000, double 0x0000000000000000>
  %z_select = select <2 x i1> %z_select.test, <2 x double> %b, <2 x double> %t_2
  %small = fmul <2 x double> <double 0x01A56E1FC2F8F359, double 0x01A56E1FC2F8F359>, %a
  %third = fadd <2 x double> %b, <double 0x3FD5555555555555, double 0x3FD5555555555555>
  %negative = fsub <2 x double> %a, <double 0xC004000000000000, double 0xC004000000000000>
  %out.0 = getelementptr double, ptr %out, i64 0
  store <2 x double> %z_add, ptr %out.0, align 8
  %out.1 = getelementptr double, ptr %out, i64 2
  store <2 x double> %z_sub, ptr %out.1, align 8
  %out.2 = getelementptr double, ptr %out, i64 4
  store <2 x double> %z_mul, ptr %out.2, align 8
  %out.3 = getelementptr double, ptr %out, i64 6
  store <2 x double> %z_div, ptr %out.3, align 8
  %out.4 = getelementptr double, ptr %out, i64 8
  store <2 x double> %z_neg, ptr %out.4, align 8
  %out.5 = getelementptr double, ptr %out, i64 10
  store <2 x double> %z_sqrt, ptr %out.5, align 8
  %out.6 = getelementptr double, ptr %out, i64 12
  store <2 x double> %z_pow, ptr %out.6, align 8
  %out.7 = getelementptr double, ptr %out, i64 14
  store <2 x double> %z_sin, ptr %out.7, align 8
  %out.8 = getelementptr double, ptr %out, i64 16
  store <2 x double> %z_cos, ptr %out.8, align 8
  %out.9 = getelementptr double, ptr %out, i64 18
  store <2 x double> %z_tan, ptr %out.9, align 8
  %out.10 = getelementptr double, ptr %out, i64 20
  store <2 x double> %z_asin, ptr %out.10, align 8
  %out.11 = getelementptr double, ptr %out, i64 22
  store <2 x double> %z_acos, ptr %out.11, align 8
  %out.12 = getelementptr double, ptr %out, i64 24
  store <2 x double> %z_atan, ptr %out.12, align 8
  %out.13 = getelementptr double, ptr %out, i64 26
  store <2 x double> %z_atan2, ptr %out.13, align 8
  %out.14 = getelementptr double, ptr %out, i64 28
  store <2 x double> %z_exp, ptr %out.14, align 8
  %out.15 = getelementptr double, ptr %out, i64 30
  store <2 x double> %z_log, ptr %out.15, align 8
  %out.16 = getelementptr double, ptr %out, i64 32
  store <2 x double> %z_sinh, ptr %out.16, align 8
  %out.17 = getelementptr double, ptr %out, i64 34
  store <2 x double> %z_cosh, ptr %out.17, align 8
  %out.18 = getelementptr double, ptr %out, i64 36
  store <2 x double> %z_tanh, ptr %out.18, align 8
  %out.19 = getelementptr double, ptr %out, i64 38
  store <2 x double> %z_abs, ptr %out.19, align 8
  %out.20 = getelementptr double, ptr %out, i64 40
  store <2 x double> %z_sign, ptr %out.20, align 8
  %out.21 = getelementptr double, ptr %out, i64 42
  store <2 x double> %z_floor, ptr %out.21, align 8
  %out.22 = getelementptr double, ptr %out, i64 44
  store <2 x double> %z_min, ptr %out.22, align 8
  %out.23 = getelementptr double, ptr %out, i64 46
  store <2 x double> %z_max, ptr %out.23, align 8
  %out.24 = getelementptr double, ptr %out, i64 48
  store <2 x double> %z_less, ptr %out.24, align 8
  %out.25 = getelementptr double, ptr %out, i64 50
  store <2 x double> %z_less_equal, ptr %out.25, align 8
  %out.26 = getelementptr double, ptr %out, i64 52
  store <2 x double> %z_select, ptr %out.26, align 8
  %out.27 = getelementptr double, ptr %out, i64 54
  store <2 x double> %small, ptr %out.27, align 8
  %out.28 = getelementptr double, ptr %out, i64 56
  store <2 x double> %third, ptr %out.28, align 8
  %out.29 = getelementptr double, ptr %out, i64 58
  store <2 x double> %negative, ptr %out.29, align 8
  %out.30 = getelementptr double, ptr %out, i64 60
  store <2 x double> <double 0xBFC0000000000000, double 0xBFC0000000000000>, ptr %out.30, align 8
  %out.31 = getelementptr double, ptr %out, i64 62
  store <2 x double> <double 0x4008000000000000, double 0x4008000000000000>, ptr %out.31, align 8
  %out.32 = getelementptr double, ptr %out, i64 64
  store <2 x double> %t_2, ptr %out.32, align 8
  ret void
}
