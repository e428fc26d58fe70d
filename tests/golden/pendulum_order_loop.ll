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

declare ptr @malloc(i64)
declare void @free(ptr)

; 1 / k as rounded, and what rounding took from it.
@table.share = internal constant [7 x double] [double 0x3FF0000000000000, double 0x3FF0000000000000, double 0x3FE0000000000000, double 0x3FD5555555555555, double 0x3FD0000000000000, double 0x3FC999999999999A, double 0x3FC5555555555555]
@table.rest = internal constant [7 x double] [double 0x0000000000000000, double 0x0000000000000000, double 0x0000000000000000, double 0x3C75555555555555, double 0x0000000000000000, double 0xBC6999999999999A, double 0x3C65555555555555]

; A Taylor step: the first orders are written out; from then on, one pass of a loop computes a coefficient of every value.
define void @step(ptr noalias nocapture %t, ptr noalias nocapture %y, ptr noalias nocapture %c, ptr noalias nocapture %s, ptr noalias nocapture %out) nounwind {
entry:
  %n.work = alloca [384 x i8], align 64
  %x.at = getelementptr double, ptr %y, i64 0
  %x = load double, ptr %x.at, align 8
  %x_dot.at = getelementptr double, ptr %y, i64 1
  %x_dot = load double, ptr %x_dot.at, align 8
  %square.at = getelementptr double, ptr %c, i64 0
  %square = load double, ptr %square.at, align 8
  %drag.at = getelementptr double, ptr %c, i64 1
  %drag = load double, ptr %drag.at, align 8
  %largest_.at = getelementptr double, ptr %s, i64 0
  %largest_ = load double, ptr %largest_.at, align 8
  %direction_.at = getelementptr double, ptr %s, i64 1
  %direction_ = load double, ptr %direction_.at, align 8
  %floor_.at = getelementptr double, ptr %s, i64 2
  %floor_ = load double, ptr %floor_.at, align 8
  %v_0_.pair.0 = insertelement <2 x double> undef, double %x, i32 0
  %v_0_.pair.1 = insertelement <2 x double> %v_0_.pair.0, double %x, i32 1
  %v_0_.pair = call {<2 x double>, <2 x double>} @sincos2(<2 x double> %v_0_.pair.1)
  %v_0_.pack = extractvalue {<2 x double>, <2 x double>} %v_0_.pair, 0
  %v_0_ = extractelement <2 x double> %v_0_.pack, i32 0
  %v_1_.pack = extractvalue {<2 x double>, <2 x double>} %v_0_.pair, 1
  %v_1_ = extractelement <2 x double> %v_1_.pack, i32 0
  %v_2_ = fmul double %square, %v_0_
  %v_3_ = fmul double %x_dot, %x_dot
  %v_4_ = fmul double %drag, %v_3_
  %v_5_ = fadd double %v_2_, %v_4_
  %v_6_ = fneg double %v_5_
  %v_7_ = fmul double %v_1_, %x_dot
  %v_8_ = fmul double %v_0_, %x_dot
  %v_9_ = fneg double %v_8_
  %v_10_ = fmul double %v_7_, %square
  %v_11_ = fmul double %x_dot, %v_6_
  %v_12_ = fmul double %v_11_, 0x4000000000000000
  %v_13_ = fmul double %v_12_, %drag
  %v_14_ = call double @llvm.fma.f64(double %v_12_, double %drag, double %v_10_)
  %v_15_ = fneg double %v_14_
  %v_16_ = fmul double %v_6_, 0x3FE0000000000000
  %v_17_ = fmul double %v_14_, 0xBFE0000000000000
  %v_18_ = fmul double %v_1_, %v_6_
  %v_19_ = call double @llvm.fma.f64(double %v_9_, double %x_dot, double %v_18_)
  %v_20_ = fmul double %v_19_, 0x3FE0000000000000
  %v_21_ = fmul double %v_0_, %v_6_
  %v_22_ = call double @llvm.fma.f64(double %v_7_, double %x_dot, double %v_21_)
  %v_23_ = fneg double %v_22_
  %v_24_ = fmul double %v_22_, 0xBFE0000000000000
  %v_25_ = fmul double %v_20_, %square
  %v_26_ = fmul double %x_dot, %v_17_
  %v_27_ = fmul double %v_26_, 0x4000000000000000
  %v_28_ = call double @llvm.fma.f64(double %v_6_, double %v_6_, double %v_27_)
  %v_29_ = fmul double %v_28_, %drag
  %v_30_ = call double @llvm.fma.f64(double %v_28_, double %drag, double %v_25_)
  %v_31_ = fneg double %v_30_
  %v_32_ = fmul double %v_17_, 0x3FD5555555555555
  %v_33_ = fmul double %v_30_, 0xBFD5555555555555
  %v_34_ = fmul double %v_9_, %v_6_
  %v_35_ = fmul double %v_7_, %v_6_
  %v_36_ = fmul double %v_6_, %v_17_
  %v_37_ = call double @llvm.fma.f64(double %v_1_, double %v_17_, double %v_34_)
  %v_38_ = call double @llvm.fma.f64(double %v_24_, double %x_dot, double %v_37_)
  %v_39_ = fmul double %v_38_, 0x3FD5555555555555
  %v_40_ = call double @llvm.fma.f64(double %v_0_, double %v_17_, double %v_35_)
  %v_41_ = call double @llvm.fma.f64(double %v_20_, double %x_dot, double %v_40_)
  %v_42_ = fneg double %v_41_
  %v_43_ = fmul double %v_41_, 0xBFD5555555555555
  %v_44_ = fmul double %v_39_, %square
  %v_45_ = call double @llvm.fma.f64(double %x_dot, double %v_33_, double %v_36_)
  %v_46_ = fmul double %v_45_, 0x4000000000000000
  %v_47_ = fmul double %v_46_, %drag
  %v_48_ = call double @llvm.fma.f64(double %v_46_, double %drag, double %v_44_)
  %v_49_ = fneg double %v_48_
  %v_50_ = fmul double %v_33_, 0x3FD0000000000000
  %v_51_ = fmul double %v_48_, 0xBFD0000000000000
  %x.1 = getelementptr i8, ptr %n.work, i64 16
  %x.2 = getelementptr i8, ptr %x.1, i64 0
  %x.3 = insertelement <2 x double> undef, double %v_6_, i32 0
  %x.4 = insertelement <2 x double> %x.3, double 0x0000000000000000, i32 1
  store <2 x double> %x.4, ptr %x.2, align 16
  %x.5 = getelementptr i8, ptr %n.work, i64 32
  %x.6 = getelementptr i8, ptr %x.5, i64 0
  %x.7 = insertelement <2 x double> undef, double %v_17_, i32 0
  %x.8 = insertelement <2 x double> %x.7, double 0x0000000000000000, i32 1
  store <2 x double> %x.8, ptr %x.6, align 16
  %x.9 = getelementptr i8, ptr %n.work, i64 48
  %x.10 = getelementptr i8, ptr %x.9, i64 0
  %x.11 = insertelement <2 x double> undef, double %v_33_, i32 0
  %x.12 = insertelement <2 x double> %x.11, double 0x0000000000000000, i32 1
  store <2 x double> %x.12, ptr %x.10, align 16
  %x.13 = getelementptr i8, ptr %n.work, i64 16
  %x.14 = getelementptr i8, ptr %x.13, i64 96
  %x.15 = insertelement <2 x double> undef, double %v_7_, i32 0
  %x.16 = insertelement <2 x double> %x.15, double %v_9_, i32 1
  store <2 x double> %x.16, ptr %x.14, align 16
  %x.17 = getelementptr i8, ptr %n.work, i64 32
  %x.18 = getelementptr i8, ptr %x.17, i64 96
  %x.19 = insertelement <2 x double> undef, double %v_20_, i32 0
  %x.20 = insertelement <2 x double> %x.19, double %v_24_, i32 1
  store <2 x double> %x.20, ptr %x.18, align 16
  %x.21 = getelementptr i8, ptr %n.work, i64 48
  %x.22 = getelementptr i8, ptr %x.21, i64 96
  %x.23 = insertelement <2 x double> undef, double %v_39_, i32 0
  %x.24 = insertelement <2 x double> %x.23, double %v_43_, i32 1
  store <2 x double> %x.24, ptr %x.22, align 16
  %x.25 = getelementptr i8, ptr %n.work, i64 16
  %x.26 = getelementptr i8, ptr %x.25, i64 192
  %x.27 = insertelement <2 x double> undef, double %v_6_, i32 0
  %x.28 = insertelement <2 x double> %x.27, double %v_6_, i32 1
  store <2 x double> %x.28, ptr %x.26, align 16
  %x.29 = getelementptr i8, ptr %n.work, i64 32
  %x.30 = getelementptr i8, ptr %x.29, i64 192
  %x.31 = insertelement <2 x double> undef, double %v_17_, i32 0
  %x.32 = insertelement <2 x double> %x.31, double %v_17_, i32 1
  store <2 x double> %x.32, ptr %x.30, align 16
  %x.33 = getelementptr i8, ptr %n.work, i64 48
  %x.34 = getelementptr i8, ptr %x.33, i64 192
  %x.35 = insertelement <2 x double> undef, double %v_33_, i32 0
  %x.36 = insertelement <2 x double> %x.35, double %v_33_, i32 1
  store <2 x double> %x.36, ptr %x.34, align 16
  %x.37 = getelementptr i8, ptr %n.work, i64 288
  store double %x_dot, ptr %x.37, align 8
  %x.38 = getelementptr i8, ptr %n.work, i64 296
  store double %v_6_, ptr %x.38, align 8
  %x.39 = getelementptr i8, ptr %n.work, i64 304
  store double %v_17_, ptr %x.39, align 8
  %x.40 = getelementptr i8, ptr %n.work, i64 312
  store double %v_33_, ptr %x.40, align 8
  %x.41 = getelementptr i8, ptr %n.work, i64 336
  store double %v_6_, ptr %x.41, align 8
  %x.42 = getelementptr i8, ptr %n.work, i64 344
  store double %v_15_, ptr %x.42, align 8
  %x.43 = getelementptr i8, ptr %n.work, i64 352
  store double %v_31_, ptr %x.43, align 8
  %x.44 = getelementptr i8, ptr %n.work, i64 360
  store double %v_49_, ptr %x.44, align 8
  %x.45 = getelementptr i8, ptr %out, i64 32
  store double %x, ptr %x.45, align 8
  %x.46 = getelementptr i8, ptr %out, i64 40
  store double %x_dot, ptr %x.46, align 8
  %x.47 = getelementptr i8, ptr %out, i64 48
  store double %v_16_, ptr %x.47, align 8
  %x.48 = getelementptr i8, ptr %out, i64 56
  store double %v_32_, ptr %x.48, align 8
  %x.49 = getelementptr i8, ptr %out, i64 64
  store double %v_50_, ptr %x.49, align 8
  %x.50 = getelementptr i8, ptr %out, i64 80
  store double %x_dot, ptr %x.50, align 8
  %x.51 = getelementptr i8, ptr %out, i64 88
  store double %v_6_, ptr %x.51, align 8
  %x.52 = getelementptr i8, ptr %out, i64 96
  store double %v_17_, ptr %x.52, align 8
  %x.53 = getelementptr i8, ptr %out, i64 104
  store double %v_33_, ptr %x.53, align 8
  %x.54 = getelementptr i8, ptr %out, i64 112
  store double %v_51_, ptr %x.54, align 8
  br label %orders
orders:
  %n.k = phi i64 [4, %entry], [%n.next, %turn]
  %carried.0 = phi double [%v_32_, %entry], [%carried.1, %turn]
  %carried.1 = phi double [%v_50_, %entry], [%v_66_, %turn]
  %carried.2 = phi double [%v_33_, %entry], [%carried.3, %turn]
  %carried.3 = phi double [%v_51_, %entry], [%v_67_, %turn]
  %carried.4 = phi double [%v_39_, %entry], [%v_54_, %turn]
  %carried.5 = phi double [%v_43_, %entry], [%v_58_, %turn]
  %carried.6 = phi double [%v_44_, %entry], [%v_59_, %turn]
  %carried.7 = phi double [%v_46_, %entry], [%v_62_, %turn]
  %carried.8 = phi double [%v_47_, %entry], [%v_63_, %turn]
  %carried.9 = phi double [%v_48_, %entry], [%v_64_, %turn]
  %carried.10 = phi double [%v_49_, %entry], [%v_65_, %turn]
  %n.next = add i64 %n.k, 1
  %n.bytes = mul i64 %n.k, 16
  %n.here = getelementptr i8, ptr %n.work, i64 %n.bytes
  ; sums of a_i a_(k-i) for i from (k - 1) / 2 down to 1, and what is in the middle of an even k
  %sum.0.below = sub i64 %n.k, 1
  %sum.0.below.half = lshr i64 %sum.0.below, 1
  %sum.0.outer = mul i64 %sum.0.below.half, 16
  %sum.0.k.half = lshr i64 %n.k, 1
  %sum.0.inner = mul i64 %sum.0.k.half, 16
  %sum.0.back = sub i64 0, %sum.0.outer
  %sum.0.high.first = getelementptr i8, ptr %n.here, i64 %sum.0.back
  %sum.0.low.first = getelementptr i8, ptr %n.work, i64 %sum.0.outer
  %sum.0.last = getelementptr i8, ptr %n.here, i64 0
  br label %sum.0.begin
sum.0.begin:
  %sum.0.none = icmp eq ptr %sum.0.high.first, %sum.0.last
  br i1 %sum.0.none, label %sum.0.end, label %sum.0
sum.0:
  %sum.0.low = phi ptr [%sum.0.low.first, %sum.0.begin], [%sum.0.low.next, %sum.0]
  %sum.0.high = phi ptr [%sum.0.high.first, %sum.0.begin], [%sum.0.high.next, %sum.0]
  %sum.0.sum.0 = phi <2 x double> [<double 0x0000000000000000, double 0x0000000000000000>, %sum.0.begin], [%sum.0.more.0, %sum.0]
  %x.55 = getelementptr i8, ptr %sum.0.low, i64 0
  %x.56 = load <2 x double>, ptr %x.55, align 16
  %x.57 = getelementptr i8, ptr %sum.0.high, i64 0
  %x.58 = load <2 x double>, ptr %x.57, align 16
  %sum.0.more.0 = call <2 x double> @llvm.fma.v2f64(<2 x double> %x.56, <2 x double> %x.58, <2 x double> %sum.0.sum.0)
  %sum.0.low.next = getelementptr i8, ptr %sum.0.low, i64 -16
  %sum.0.high.next = getelementptr i8, ptr %sum.0.high, i64 16
  %sum.0.done = icmp eq ptr %sum.0.high.next, %sum.0.last
  br i1 %sum.0.done, label %sum.0.end, label %sum.0
sum.0.end:
  %sum.0.total.0 = phi <2 x double> [<double 0x0000000000000000, double 0x0000000000000000>, %sum.0.begin], [%sum.0.more.0, %sum.0]
  %sum.0.odd = trunc i64 %n.k to i1
  %sum.0.middle = getelementptr i8, ptr %n.work, i64 %sum.0.inner
  %x.59 = getelementptr i8, ptr %sum.0.middle, i64 0
  %x.60 = load <2 x double>, ptr %x.59, align 16
  %x.61 = select i1 %sum.0.odd, <2 x double> <double 0x0000000000000000, double 0x0000000000000000>, <2 x double> %x.60
  %middle.0.0 = extractelement <2 x double> %x.61, i32 0
  %inner.0.0 = extractelement <2 x double> %sum.0.total.0, i32 0
  ; sums of a_i b_(m-i), m = k or k - 1: i from 2 to m - 2, which may be none, then 1 and m - 1
  %sum.1.bytes = sub i64 %n.bytes, 16
  %sum.1.last = getelementptr i8, ptr %n.work, i64 16
  %sum.1.low.first = getelementptr i8, ptr %sum.1.last, i64 16
  %sum.1.order = getelementptr i8, ptr %n.work, i64 %sum.1.bytes
  %sum.1.high.first = getelementptr i8, ptr %sum.1.order, i64 -32
  br label %sum.1.begin
sum.1.begin:
  %sum.1.none = icmp eq ptr %sum.1.high.first, %sum.1.last
  br i1 %sum.1.none, label %sum.1.end, label %sum.1
sum.1:
  %sum.1.low = phi ptr [%sum.1.low.first, %sum.1.begin], [%sum.1.low.next, %sum.1]
  %sum.1.high = phi ptr [%sum.1.high.first, %sum.1.begin], [%sum.1.high.next, %sum.1]
  %sum.1.sum.1 = phi <2 x double> [<double 0x0000000000000000, double 0x0000000000000000>, %sum.1.begin], [%sum.1.more.1, %sum.1]
  %x.62 = getelementptr i8, ptr %sum.1.low, i64 96
  %x.63 = load <2 x double>, ptr %x.62, align 16
  %x.64 = getelementptr i8, ptr %sum.1.high, i64 192
  %x.65 = load <2 x double>, ptr %x.64, align 16
  %sum.1.more.1 = call <2 x double> @llvm.fma.v2f64(<2 x double> %x.63, <2 x double> %x.65, <2 x double> %sum.1.sum.1)
  %sum.1.low.next = getelementptr i8, ptr %sum.1.low, i64 16
  %sum.1.high.next = getelementptr i8, ptr %sum.1.high, i64 -16
  %sum.1.done = icmp eq ptr %sum.1.high.next, %sum.1.last
  br i1 %sum.1.done, label %sum.1.end, label %sum.1
sum.1.end:
  %sum.1.total.1 = phi <2 x double> [<double 0x0000000000000000, double 0x0000000000000000>, %sum.1.begin], [%sum.1.more.1, %sum.1]
  %sum.1.order.again = getelementptr i8, ptr %n.work, i64 %sum.1.bytes
  %sum.1.newest = getelementptr i8, ptr %sum.1.order.again, i64 -16
  %x.66 = getelementptr i8, ptr %sum.1.last, i64 96
  %x.67 = load <2 x double>, ptr %x.66, align 16
  %x.68 = getelementptr i8, ptr %sum.1.newest, i64 192
  %x.69 = load <2 x double>, ptr %x.68, align 16
  %x.70 = call <2 x double> @llvm.fma.v2f64(<2 x double> %x.67, <2 x double> %x.69, <2 x double> %sum.1.total.1)
  %x.71 = getelementptr i8, ptr %sum.1.newest, i64 96
  %x.72 = load <2 x double>, ptr %x.71, align 16
  %x.73 = getelementptr i8, ptr %sum.1.last, i64 192
  %x.74 = load <2 x double>, ptr %x.73, align 16
  %x.75 = call <2 x double> @llvm.fma.v2f64(<2 x double> %x.72, <2 x double> %x.74, <2 x double> %x.70)
  %inner.1.0 = extractelement <2 x double> %x.75, i32 0
  %inner.1.1 = extractelement <2 x double> %x.75, i32 1
  %now.share.at = getelementptr double, ptr @table.share, i64 %n.k
  %now.share.one = load double, ptr %now.share.at, align 8
  %now.share = bitcast double %now.share.one to double
  %now.rest.at = getelementptr double, ptr @table.rest, i64 %n.k
  %now.rest.one = load double, ptr %now.rest.at, align 8
  %now.rest = bitcast double %now.rest.one to double
  %next.share.at = getelementptr double, ptr @table.share, i64 %n.next
  %next.share.one = load double, ptr %next.share.at, align 8
  %next.share = bitcast double %next.share.one to double
  %next.rest.at = getelementptr double, ptr @table.rest, i64 %n.next
  %next.rest.one = load double, ptr %next.rest.at, align 8
  %next.rest = bitcast double %next.rest.one to double
  %now.order.one = uitofp i64 %n.k to double
  %now.order = bitcast double %now.order.one to double
  %v_52_ = call double @llvm.fma.f64(double %v_1_, double %carried.2, double %inner.1.1)
  %v_53_ = call double @llvm.fma.f64(double %carried.5, double %x_dot, double %v_52_)
  %v_54_ = fmul double %v_53_, %now.share
  %v_55_ = call double @llvm.fma.f64(double %v_0_, double %carried.2, double %inner.1.0)
  %v_56_ = call double @llvm.fma.f64(double %carried.4, double %x_dot, double %v_55_)
  %v_57_ = fneg double %v_56_
  %v_58_ = fmul double %v_57_, %now.share
  %v_59_ = fmul double %v_54_, %square
  %v_60_ = call double @llvm.fma.f64(double %x_dot, double %carried.3, double %inner.0.0)
  %v_61_ = fmul double %v_60_, 0x4000000000000000
  %v_62_ = call double @llvm.fma.f64(double %middle.0.0, double %middle.0.0, double %v_61_)
  %v_63_ = fmul double %v_62_, %drag
  %v_64_ = call double @llvm.fma.f64(double %v_62_, double %drag, double %v_59_)
  %v_65_ = fneg double %v_64_
  %v_66_ = fmul double %carried.3, %next.share
  %v_67_ = fmul double %v_65_, %next.share
  %x.76 = getelementptr i8, ptr %n.here, i64 0
  %x.77 = getelementptr i8, ptr %x.76, i64 0
  %x.78 = insertelement <2 x double> undef, double %carried.3, i32 0
  %x.79 = insertelement <2 x double> %x.78, double 0x0000000000000000, i32 1
  store <2 x double> %x.79, ptr %x.77, align 16
  %x.80 = getelementptr i8, ptr %n.here, i64 0
  %x.81 = getelementptr i8, ptr %x.80, i64 96
  %x.82 = insertelement <2 x double> undef, double %v_54_, i32 0
  %x.83 = insertelement <2 x double> %x.82, double %v_58_, i32 1
  store <2 x double> %x.83, ptr %x.81, align 16
  %x.84 = getelementptr i8, ptr %n.here, i64 0
  %x.85 = getelementptr i8, ptr %x.84, i64 192
  %x.86 = insertelement <2 x double> undef, double %carried.3, i32 0
  %x.87 = insertelement <2 x double> %x.86, double %carried.3, i32 1
  store <2 x double> %x.87, ptr %x.85, align 16
  %x.88 = mul i64 %n.k, 8
  %x.89 = getelementptr i8, ptr %n.work, i64 %x.88
  %x.90 = getelementptr i8, ptr %x.89, i64 288
  store double %carried.3, ptr %x.90, align 8
  %x.91 = getelementptr i8, ptr %n.work, i64 %x.88
  %x.92 = getelementptr i8, ptr %x.91, i64 336
  store double %v_65_, ptr %x.92, align 8
  %x.93 = getelementptr i8, ptr %out, i64 %x.88
  %x.94 = getelementptr i8, ptr %x.93, i64 40
  store double %v_66_, ptr %x.94, align 8
  %x.95 = getelementptr i8, ptr %out, i64 %x.88
  %x.96 = getelementptr i8, ptr %x.95, i64 88
  store double %v_67_, ptr %x.96, align 8
  %n.closed = icmp eq i64 %n.next, 5
  br label %turn
turn:
  br i1 %n.closed, label %close, label %orders
close:
  %v_68_ = call double @llvm.fabs.f64(double %x_dot)
  %v_69_.test = fcmp ogt double %floor_, %v_68_
  %v_69_ = select i1 %v_69_.test, double %floor_, double %v_68_
  %v_70_ = call double @llvm.fabs.f64(double %x)
  %v_71_.test = fcmp olt double %v_70_, 0x402921FB54442D18
  %v_71_ = select i1 %v_71_.test, double %v_70_, double 0x402921FB54442D18
  %v_72_.test = fcmp ogt double %v_69_, %v_71_
  %v_72_ = select i1 %v_72_.test, double %v_69_, double %v_71_
  %v_73_ = call double @rough_log2(double %v_72_)
  %v_74_ = call double @llvm.fabs.f64(double %v_33_)
  %v_75_ = call double @llvm.fabs.f64(double %v_49_)
  %v_76_.test = fcmp ogt double 0x01A56E1FC2F8F359, %v_74_
  %v_76_ = select i1 %v_76_.test, double 0x01A56E1FC2F8F359, double %v_74_
  %v_77_.test = fcmp ogt double %v_76_, %v_75_
  %v_77_ = select i1 %v_77_.test, double %v_76_, double %v_75_
  %v_78_ = call double @rough_log2(double %v_77_)
  %v_79_ = fsub double %v_73_, %v_78_
  %v_80_ = fadd double %v_79_, 0x4000000000000000
  %v_81_ = fmul double %v_80_, 0x3FD0000000000000
  %v_82_ = call double @llvm.fabs.f64(double %carried.3)
  %v_83_ = call double @llvm.fabs.f64(double %v_65_)
  %v_84_.test = fcmp ogt double 0x01A56E1FC2F8F359, %v_82_
  %v_84_ = select i1 %v_84_.test, double 0x01A56E1FC2F8F359, double %v_82_
  %v_85_.test = fcmp ogt double %v_84_, %v_83_
  %v_85_ = select i1 %v_85_.test, double %v_84_, double %v_83_
  %v_86_ = call double @rough_log2(double %v_85_)
  %v_87_ = fsub double %v_73_, %v_86_
  %v_88_ = fadd double %v_87_, 0x4002934F0979A371
  %v_89_ = fmul double %v_88_, 0x3FC999999999999A
  %v_90_.test = fcmp olt double %v_89_, %v_81_
  %v_90_ = select i1 %v_90_.test, double %v_89_, double %v_81_
  %v_91_ = fadd double %v_90_, 0xC0047C7C29C9D10F
  %v_92_ = call double @rough_exp2(double %v_91_)
  %v_93_.test = fcmp olt double %v_92_, %largest_
  %v_93_ = select i1 %v_93_.test, double %v_92_, double %largest_
  %v_94_ = fmul double %v_93_, %direction_
  %v_95_ = fmul double %v_94_, %v_94_
  %v_96_ = fmul double %v_95_, %v_95_
  %v_97_ = fmul double %carried.3, 0x3FC999999999999A
  %v_98_ = call double @llvm.fma.f64(double %v_94_, double %v_16_, double %x_dot)
  %v_99_ = call double @llvm.fma.f64(double %v_94_, double %v_50_, double %v_32_)
  %v_100_ = call double @llvm.fma.f64(double %v_95_, double %v_99_, double %v_98_)
  %v_101_ = call double @llvm.fma.f64(double %v_96_, double %v_97_, double %v_100_)
  %v_102_ = fmul double %v_101_, %v_94_
  %v_103_ = fadd double %x, %v_102_
  %v_104_ = call double @llvm.fma.f64(double %v_103_, double 0x0000000000000000, double 0x0000000000000000)
  %v_105_ = fmul double %v_64_, 0xBFC999999999999A
  %v_106_ = call double @llvm.fma.f64(double %v_94_, double %v_17_, double %v_6_)
  %v_107_ = call double @llvm.fma.f64(double %v_94_, double %v_51_, double %v_33_)
  %v_108_ = call double @llvm.fma.f64(double %v_95_, double %v_107_, double %v_106_)
  %v_109_ = call double @llvm.fma.f64(double %v_96_, double %v_105_, double %v_108_)
  %v_110_ = fmul double %v_109_, %v_94_
  %v_111_ = fadd double %x_dot, %v_110_
  %v_112_ = call double @llvm.fma.f64(double %v_111_, double 0x0000000000000000, double %v_104_)
  %out.0 = getelementptr double, ptr %out, i64 0
  store double %v_103_, ptr %out.0, align 8
  %out.1 = getelementptr double, ptr %out, i64 1
  store double %v_111_, ptr %out.1, align 8
  %out.2 = getelementptr double, ptr %out, i64 2
  store double %v_93_, ptr %out.2, align 8
  %out.3 = getelementptr double, ptr %out, i64 3
  store double %v_112_, ptr %out.3, align 8
  ret void
}
