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
declare double @llvm.fabs.f64(double)
declare double @llvm.sqrt.f64(double)
declare double @llvm.floor.f64(double)
declare double @llvm.fma.f64(double, double, double)
declare <2 x double> @llvm.fabs.v2f64(<2 x double>)
declare <2 x double> @llvm.sqrt.v2f64(<2 x double>)
declare <2 x double> @llvm.floor.v2f64(<2 x double>)
declare <2 x double> @llvm.fma.v2f64(<2 x double>, <2 x double>, <2 x double>)
declare <4 x double> @llvm.fabs.v4f64(<4 x double>)
declare <4 x double> @llvm.sqrt.v4f64(<4 x double>)
declare <4 x double> @llvm.floor.v4f64(<4 x double>)
declare <4 x double> @llvm.fma.v4f64(<4 x double>, <4 x double>, <4 x double>)
declare <8 x double> @llvm.fabs.v8f64(<8 x double>)
declare <8 x double> @llvm.sqrt.v8f64(<8 x double>)
declare <8 x double> @llvm.floor.v8f64(<8 x double>)
declare <8 x double> @llvm.fma.v8f64(<8 x double>, <8 x double>, <8 x double>)

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

define internal {<4 x double>, <4 x double>} @sincos4(<4 x double> %x) alwaysinline nounwind {
entry:
  %size = call <4 x double> @llvm.fabs.v4f64(<4 x double> %x)
  %large = fcmp ugt <4 x double> %size, <double 0x412E848000000000, double 0x412E848000000000, double 0x412E848000000000, double 0x412E848000000000>
  %bits = bitcast <4 x i1> %large to i4
  %any = icmp ne i4 %bits, 0
  %shifted = call <4 x double> @llvm.fma.v4f64(<4 x double> %x, <4 x double> <double 0x3FE45F306DC9C883, double 0x3FE45F306DC9C883, double 0x3FE45F306DC9C883, double 0x3FE45F306DC9C883>, <4 x double> <double 0x4338000000000000, double 0x4338000000000000, double 0x4338000000000000, double 0x4338000000000000>)
  %k = fsub <4 x double> %shifted, <double 0x4338000000000000, double 0x4338000000000000, double 0x4338000000000000, double 0x4338000000000000>
  %q = bitcast <4 x double> %shifted to <4 x i64>
  %minus = fneg <4 x double> %k
  %r1 = call <4 x double> @llvm.fma.v4f64(<4 x double> %minus, <4 x double> <double 0x3FF921FB54400000, double 0x3FF921FB54400000, double 0x3FF921FB54400000, double 0x3FF921FB54400000>, <4 x double> %x)
  %r2 = call <4 x double> @llvm.fma.v4f64(<4 x double> %minus, <4 x double> <double 0x3DD0B4611A600000, double 0x3DD0B4611A600000, double 0x3DD0B4611A600000, double 0x3DD0B4611A600000>, <4 x double> %r1)
  %r = call <4 x double> @llvm.fma.v4f64(<4 x double> %minus, <4 x double> <double 0x3BA3198A2E037073, double 0x3BA3198A2E037073, double 0x3BA3198A2E037073, double 0x3BA3198A2E037073>, <4 x double> %r2)
  %z = fmul <4 x double> %r, %r
  %sp.4 = call <4 x double> @llvm.fma.v4f64(<4 x double> <double 0x3DE5D93A5ACFD57C, double 0x3DE5D93A5ACFD57C, double 0x3DE5D93A5ACFD57C, double 0x3DE5D93A5ACFD57C>, <4 x double> %z, <4 x double> <double 0xBE5AE5E68A2B9CEB, double 0xBE5AE5E68A2B9CEB, double 0xBE5AE5E68A2B9CEB, double 0xBE5AE5E68A2B9CEB>)
  %sp.3 = call <4 x double> @llvm.fma.v4f64(<4 x double> %sp.4, <4 x double> %z, <4 x double> <double 0x3EC71DE357B1FE7D, double 0x3EC71DE357B1FE7D, double 0x3EC71DE357B1FE7D, double 0x3EC71DE357B1FE7D>)
  %sp.2 = call <4 x double> @llvm.fma.v4f64(<4 x double> %sp.3, <4 x double> %z, <4 x double> <double 0xBF2A01A019C161D5, double 0xBF2A01A019C161D5, double 0xBF2A01A019C161D5, double 0xBF2A01A019C161D5>)
  %sp.1 = call <4 x double> @llvm.fma.v4f64(<4 x double> %sp.2, <4 x double> %z, <4 x double> <double 0x3F8111111110F8A6, double 0x3F8111111110F8A6, double 0x3F8111111110F8A6, double 0x3F8111111110F8A6>)
  %sp = call <4 x double> @llvm.fma.v4f64(<4 x double> %sp.1, <4 x double> %z, <4 x double> <double 0xBFC5555555555549, double 0xBFC5555555555549, double 0xBFC5555555555549, double 0xBFC5555555555549>)
  %cp.4 = call <4 x double> @llvm.fma.v4f64(<4 x double> <double 0xBDA8FAE9BE8838D4, double 0xBDA8FAE9BE8838D4, double 0xBDA8FAE9BE8838D4, double 0xBDA8FAE9BE8838D4>, <4 x double> %z, <4 x double> <double 0x3E21EE9EBDB4B1C4, double 0x3E21EE9EBDB4B1C4, double 0x3E21EE9EBDB4B1C4, double 0x3E21EE9EBDB4B1C4>)
  %cp.3 = call <4 x double> @llvm.fma.v4f64(<4 x double> %cp.4, <4 x double> %z, <4 x double> <double 0xBE927E4F809C52AD, double 0xBE927E4F809C52AD, double 0xBE927E4F809C52AD, double 0xBE927E4F809C52AD>)
  %cp.2 = call <4 x double> @llvm.fma.v4f64(<4 x double> %cp.3, <4 x double> %z, <4 x double> <double 0x3EFA01A019CB1590, double 0x3EFA01A019CB1590, double 0x3EFA01A019CB1590, double 0x3EFA01A019CB1590>)
  %cp.1 = call <4 x double> @llvm.fma.v4f64(<4 x double> %cp.2, <4 x double> %z, <4 x double> <double 0xBF56C16C16C15177, double 0xBF56C16C16C15177, double 0xBF56C16C16C15177, double 0xBF56C16C16C15177>)
  %cp = call <4 x double> @llvm.fma.v4f64(<4 x double> %cp.1, <4 x double> %z, <4 x double> <double 0x3FA555555555554C, double 0x3FA555555555554C, double 0x3FA555555555554C, double 0x3FA555555555554C>)
  %rz = fmul <4 x double> %r, %z
  %sine = call <4 x double> @llvm.fma.v4f64(<4 x double> %rz, <4 x double> %sp, <4 x double> %r)
  %hz = fmul <4 x double> %z, <double 0x3FE0000000000000, double 0x3FE0000000000000, double 0x3FE0000000000000, double 0x3FE0000000000000>
  %one = fsub <4 x double> <double 0x3FF0000000000000, double 0x3FF0000000000000, double 0x3FF0000000000000, double 0x3FF0000000000000>, %hz
  %lost = fsub <4 x double> <double 0x3FF0000000000000, double 0x3FF0000000000000, double 0x3FF0000000000000, double 0x3FF0000000000000>, %one
  %rest = fsub <4 x double> %lost, %hz
  %zz = fmul <4 x double> %z, %z
  %tail = call <4 x double> @llvm.fma.v4f64(<4 x double> %zz, <4 x double> %cp, <4 x double> %rest)
  %cosine = fadd <4 x double> %one, %tail
  %low = and <4 x i64> %q, <i64 1, i64 1, i64 1, i64 1>
  %odd = icmp ne <4 x i64> %low, <i64 0, i64 0, i64 0, i64 0>
  %s.a = select <4 x i1> %odd, <4 x double> %cosine, <4 x double> %sine
  %c.a = select <4 x i1> %odd, <4 x double> %sine, <4 x double> %cosine
  %s.bit = and <4 x i64> %q, <i64 2, i64 2, i64 2, i64 2>
  %s.sign = shl <4 x i64> %s.bit, <i64 62, i64 62, i64 62, i64 62>
  %q1 = add <4 x i64> %q, <i64 1, i64 1, i64 1, i64 1>
  %c.bit = and <4 x i64> %q1, <i64 2, i64 2, i64 2, i64 2>
  %c.sign = shl <4 x i64> %c.bit, <i64 62, i64 62, i64 62, i64 62>
  %s.i = bitcast <4 x double> %s.a to <4 x i64>
  %c.i = bitcast <4 x double> %c.a to <4 x i64>
  %s.x = xor <4 x i64> %s.i, %s.sign
  %c.x = xor <4 x i64> %c.i, %c.sign
  %s.f = bitcast <4 x i64> %s.x to <4 x double>
  %c.f = bitcast <4 x i64> %c.x to <4 x double>
  br i1 %any, label %slow, label %done
slow:
  %slow.s.0.0 = extractelement <4 x double> %x, i32 0
  %slow.s.0 = call double @sin(double %slow.s.0.0)
  %slow.s.pack0 = insertelement <4 x double> undef, double %slow.s.0, i32 0
  %slow.s.1.0 = extractelement <4 x double> %x, i32 1
  %slow.s.1 = call double @sin(double %slow.s.1.0)
  %slow.s.pack1 = insertelement <4 x double> %slow.s.pack0, double %slow.s.1, i32 1
  %slow.s.2.0 = extractelement <4 x double> %x, i32 2
  %slow.s.2 = call double @sin(double %slow.s.2.0)
  %slow.s.pack2 = insertelement <4 x double> %slow.s.pack1, double %slow.s.2, i32 2
  %slow.s.3.0 = extractelement <4 x double> %x, i32 3
  %slow.s.3 = call double @sin(double %slow.s.3.0)
  %slow.s = insertelement <4 x double> %slow.s.pack2, double %slow.s.3, i32 3
  %slow.c.0.0 = extractelement <4 x double> %x, i32 0
  %slow.c.0 = call double @cos(double %slow.c.0.0)
  %slow.c.pack0 = insertelement <4 x double> undef, double %slow.c.0, i32 0
  %slow.c.1.0 = extractelement <4 x double> %x, i32 1
  %slow.c.1 = call double @cos(double %slow.c.1.0)
  %slow.c.pack1 = insertelement <4 x double> %slow.c.pack0, double %slow.c.1, i32 1
  %slow.c.2.0 = extractelement <4 x double> %x, i32 2
  %slow.c.2 = call double @cos(double %slow.c.2.0)
  %slow.c.pack2 = insertelement <4 x double> %slow.c.pack1, double %slow.c.2, i32 2
  %slow.c.3.0 = extractelement <4 x double> %x, i32 3
  %slow.c.3 = call double @cos(double %slow.c.3.0)
  %slow.c = insertelement <4 x double> %slow.c.pack2, double %slow.c.3, i32 3
  ; the neighbours of a large argument keep what they would have alone
  %s.l = select <4 x i1> %large, <4 x double> %slow.s, <4 x double> %s.f
  %c.l = select <4 x i1> %large, <4 x double> %slow.c, <4 x double> %c.f
  br label %done
done:
  %s = phi <4 x double> [%s.f, %entry], [%s.l, %slow]
  %c = phi <4 x double> [%c.f, %entry], [%c.l, %slow]
  %pair = insertvalue {<4 x double>, <4 x double>} undef, <4 x double> %s, 0
  %both = insertvalue {<4 x double>, <4 x double>} %pair, <4 x double> %c, 1
  ret {<4 x double>, <4 x double>} %both
}

; Good to 0.005 for positive normal numbers: the bits of a number, read as an integer, are its logarithm with straight
; lines between the powers of two; a parabola takes off most of what that is wrong by.
define internal double @rough_log2(double %x) alwaysinline nounwind {
  %i = bitcast double %x to i64
  %high = lshr i64 %i, 12
  %magic = or i64 %high, 4841369599423283200
  %float = bitcast i64 %magic to double
  %m.raw = and i64 %i, 4503599627370495
  %m.one = or i64 %m.raw, 4607182418800017408
  %m = bitcast i64 %m.one to double
  %line = call double @llvm.fma.f64(double %float, double 0x3D70000000000000, double 0xC0B3FFACC4C79AB4)
  %slope = call double @llvm.fma.f64(double 0xBFD611FE8FE86AE3, double %m, double 0x3FF06507B987CB91)
  %log = call double @llvm.fma.f64(double %slope, double %m, double %line)
  ret double %log
}

; Good to 1e-4 relative; the argument is limited to +-1000.
define internal double @rough_exp2(double %x) alwaysinline nounwind {
  %above = fcmp ogt double %x, 0xC08F400000000000
  %x.low = select i1 %above, double %x, double 0xC08F400000000000
  %below = fcmp olt double %x.low, 0x408F400000000000
  %x.held = select i1 %below, double %x.low, double 0x408F400000000000
  %shifted = fadd double %x.held, 0x4338000000000000
  %whole = fsub double %shifted, 0x4338000000000000
  %r = fsub double %x.held, %whole
  %i = bitcast double %shifted to i64
  %exponent = shl i64 %i, 52
  %p.2 = call double @llvm.fma.f64(double 0x3FAC3F760CA1A3FF, double %r, double 0x3FCF0DE1BFF8FEDA)
  %p.1 = call double @llvm.fma.f64(double %p.2, double %r, double 0x3FE62F31ABF4900A)
  %p = call double @llvm.fma.f64(double %p.1, double %r, double 0x3FEFFF6926E013A6)
  %p.bits = bitcast double %p to i64
  %bits = add i64 %p.bits, %exponent
  %power = bitcast i64 %bits to double
  ret double %power
}

define void @rhs.piece0(ptr noalias nocapture %t, ptr noalias nocapture %y, ptr noalias nocapture %c, ptr noalias nocapture %kept, ptr noalias nocapture %out) nounwind {
  %square.at = getelementptr double, ptr %c, i64 0
  %square = load double, ptr %square.at, align 8
  %x.at = getelementptr double, ptr %y, i64 0
  %x = load double, ptr %x.at, align 8
  %x_dot.at = getelementptr double, ptr %y, i64 1
  %x_dot = load double, ptr %x_dot.at, align 8
  %sine.pair.0 = insertelement <2 x double> undef, double %x, i32 0
  %sine.pair.1 = insertelement <2 x double> %sine.pair.0, double %x, i32 1
  %sine.pair = call {<2 x double>, <2 x double>} @sincos2(<2 x double> %sine.pair.1)
  %sine.pack = extractvalue {<2 x double>, <2 x double>} %sine.pair, 0
  %sine = extractelement <2 x double> %sine.pack, i32 0
  %weight = fmul double %square, %sine
  %speed = fmul double %x_dot, %x_dot
  %out.0 = getelementptr double, ptr %out, i64 0
  store double %weight, ptr %out.0, align 8
  %out.1 = getelementptr double, ptr %out, i64 1
  store double %speed, ptr %out.1, align 8
  ret void
}

define void @rhs.piece1(ptr noalias nocapture %t, ptr noalias nocapture %y, ptr noalias nocapture %c, ptr noalias nocapture %kept, ptr noalias nocapture %out) nounwind {
  %drag.at = getelementptr double, ptr %c, i64 1
  %drag = load double, ptr %drag.at, align 8
  %weight.at = getelementptr double, ptr %kept, i64 0
  %weight = load double, ptr %weight.at, align 8
  %speed.at = getelementptr double, ptr %kept, i64 1
  %speed = load double, ptr %speed.at, align 8
  %x_dot.at = getelementptr double, ptr %y, i64 1
  %x_dot = load double, ptr %x_dot.at, align 8
  %resistance = fmul double %drag, %speed
  %pull = fadd double %weight, %resistance
  %rate = fneg double %pull
  %out.0 = getelementptr double, ptr %out, i64 0
  store double %x_dot, ptr %out.0, align 8
  %out.1 = getelementptr double, ptr %out, i64 1
  store double %rate, ptr %out.1, align 8
  ret void
}

define void @rhs(ptr noalias nocapture %t, ptr noalias nocapture %y, ptr noalias nocapture %c, ptr noalias nocapture %out) nounwind {
  %n.work = alloca [16 x i8], align 64
  call void @rhs.piece0(ptr %t, ptr %y, ptr %c, ptr %n.work, ptr %n.work)
  call void @rhs.piece1(ptr %t, ptr %y, ptr %c, ptr %n.work, ptr %out)
  ret void
}
